# SPDX-License-Identifier: Apache-2.0
"""Whether verdicts are right: good data sets refused, wrong ones accepted.

Data sets are drawn by seed (tests/harness/stiffness_lab.py): five robots, 5 to 15 configurations,
4 to 10 loads, one or three reflectors or whole poses, noise over a decade, half of them with a
stiffness that scatters by 5 to 30 % from configuration to configuration. A run that is stopped
goes on where it was; figures are of all sets in build/bench/verdict.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

import numpy as np
from record import write_figures

import stiffness_lab as lab
from cabols_control.errors import CabolsError
from cabols_stiffness import identify
from line_journal import LineJournal

FOLDER = Path("build/bench/verdict")
MOST_FALSE = 0.02
FAR = 4.0
"""Standard deviations beyond which a stiffness that is shown is wrong."""


def mean_of(true):
    """(n,) pooled true stiffness: of the mean compliance."""
    return 1.0 / np.mean(1.0 / true, axis=0)


def good(journal, seed):
    """Judge a data set in which nothing is wrong."""
    rng = np.random.default_rng(seed)
    design = lab.drawn_design(rng)
    samples, robot, _ = lab.measure(design, rng)
    values = {"robot": design.robot, "scatter": design.scatter, "samples": len(samples)}
    try:
        result = identify(samples, robot)
    except CabolsError as error:
        journal.add(seed, refused=True, why=type(error).__name__, **values)
        return
    causes = [one.suspect.value for one in result.verdict.findings if one.grave]
    usable = result.adequate and result.converged
    journal.add(seed, refused=not usable, why=causes, grade=result.verdict.grade.value, **values)


def wrong(journal, seed):
    """Judge a data set with each mistake in turn."""
    rng = np.random.default_rng([seed, 1])
    design = lab.drawn_design(rng)
    samples, robot, true = lab.measure(design, rng)
    for name, change in lab.mistakes(design, robot.n):
        key = f"{seed}: {name}"
        if key in journal.found:
            continue
        try:
            result = identify(change(samples), robot)
        except CabolsError:
            journal.add(key, mistake=name, outcome="refused")
            continue
        if not (result.adequate and result.converged):
            journal.add(key, mistake=name, outcome="refused")
            continue
        error = np.abs(result.stiffness - mean_of(true)) / result.standard_deviation
        shown = error[result.identifiable]
        outcome = "harmless" if np.all(shown <= FAR) else "accepted"
        journal.add(
            key,
            mistake=name,
            outcome=outcome,
            robot=design.robot,
            scatter=design.scatter,
            probability=result.verdict.probability,
            worst=float(shown.max(initial=0.0)),
        )


def kind_of(mistake):
    """Mistakes of one kind share a row."""
    if "exchanged" in mistake and mistake.startswith("joints"):
        return "two joints exchanged"
    for kind in ("sign of joint", "zero of joint"):
        if mistake.startswith(kind):
            return f"{kind} changed"
    return mistake


def summary(good_sets, wrong_sets):
    """Print figures; return them."""
    refused = [one for one in good_sets.found.values() if one["refused"]]
    count = max(len(good_sets.found), 1)
    scattered = [one for one in good_sets.found.values() if one["scatter"] > 0.0]
    of_them = sum(one["scatter"] > 0.0 for one in refused)
    share = len(refused) / count
    most = f"at most {100 * MOST_FALSE:.0f} %"
    print(f"good data sets refused: {len(refused)} of {count}, {100 * share:.2f} % ({most})")
    print(f"  of {len(scattered)} that scatter: {of_them}")
    for why, times in Counter(str(one["why"]) for one in refused).most_common():
        print(f"  {times:4d}  {why}")
    kinds = {}
    for one in wrong_sets.found.values():
        kinds.setdefault(kind_of(one["mistake"]), Counter())[one["outcome"]] += 1
    total = sum(kinds.values(), Counter())
    print(f"\nwrong data: {sum(total.values())} sets, {total['refused']} refused, "
          f"{total['harmless']} harmless (what is shown is within {FAR:g} deviations "
          f"of the truth), {total['accepted']} accepted though wrong")  # fmt: skip
    print(f"  {'mistake':44s}  refused  harmless  accepted")
    for kind, found in sorted(kinds.items()):
        print(f"  {kind:44s}{found['refused']:9d}{found['harmless']:10d}{found['accepted']:10d}")
    for key, one in wrong_sets.found.items():
        if one["outcome"] == "accepted":
            print(f"  accepted: {key}: {one['robot']}, scatter {one['scatter']:.2f}, chi-square's "
                  f"p = {one['probability']:.2g}, {one['worst']:.1f} deviations off")  # fmt: skip
    return {
        "good_sets": len(good_sets.found),
        "good_refused": len(refused),
        "good_refused_share": share,
        "wrong_sets": int(sum(total.values())),
        **{f"wrong_{name}": int(times) for name, times in total.items()},
    }


def main():
    """Run the bench; 1 if more than MOST_FALSE of the good sets were refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--good", type=int, default=1000, help="good data sets, in all")
    parser.add_argument("--wrong", type=int, default=20, help="sets with every mistake, in all")
    parser.add_argument("--first", type=int, default=0, help="seed of the first set")
    parser.add_argument("--short", action="store_true", help="a form of about five minutes")
    parser.add_argument("--fresh", action="store_true", help="forget earlier runs")
    options = parser.parse_args()
    count, sets = (200, 2) if options.short else (options.good, options.wrong)
    folder = FOLDER / "short" if options.short else FOLDER
    good_sets = LineJournal(folder / "good.jsonl", options.fresh)
    wrong_sets = LineJournal(folder / "wrong.jsonl", options.fresh)
    for seed in range(options.first, options.first + count):
        if seed not in good_sets.found:
            good(good_sets, seed)
        if (seed + 1) % 50 == 0:
            print(f"  {seed + 1} good sets", file=sys.stderr, flush=True)
    for seed in range(options.first, options.first + sets):
        wrong(wrong_sets, seed)
        print(f"  {seed + 1} sets with every mistake", file=sys.stderr, flush=True)
    figures = summary(good_sets, wrong_sets)
    write_figures(Path("build/bench/verdict.json"), figures)
    return int(figures["good_refused_share"] > MOST_FALSE)


if __name__ == "__main__":
    sys.exit(main())
