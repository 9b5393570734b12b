# SPDX-License-Identifier: Apache-2.0
"""Rows of the tables in docs/figures.md, from each benchmark's JSON file; see figures.py."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Figures = Mapping[str, Any]
Row = tuple[str, str, str, "bool | None"]
"""Quantity, measured, target, whether it is met; None without a target."""


@dataclass(frozen=True)
class Block:
    """One command's block of the page.

    Attributes:
        name: in the page's markers.
        file: JSON below build/.
        title: heading.
        rows: makes the table's rows from the file's content.
    """

    name: str
    file: str
    title: str
    rows: Callable[[Figures], Iterable[Row]]


def number(value: float, digits: int = 3) -> str:
    """Write a number with a few significant digits, without an exponent where one can."""
    if value == 0.0 or not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}g}" if value else "0"
    return f"{value:.{digits}g}" if abs(value) < 1000.0 else f"{value:.0f}"


def span(values: Sequence[float], factor: float = 1.0) -> str:
    """Write the least and the largest of some values."""
    return f"{number(factor * min(values))} to {number(factor * max(values))}"


def tension(f: Figures) -> Iterable[Row]:
    """Rows of bench-tension."""
    taken = f["figures"]
    yield "fixed pose, one call: median, p99", _us(taken, "fixed_into"), "", None
    yield "new pose, structure matrix included: median, p99", _us(taken, "pose_into"), "", None
    for item in f["targets"]:
        least = "at least" if item["least"] else "at most"
        limit = f"{least} {item['limit']:g}"
        yield item["name"] + ", ratio", number(item["ratio"]), limit, item["met"]


def _us(taken: Figures, name: str) -> str:
    return f"{number(taken[f'{name}_median_us'])}, {number(taken[f'{name}_p99_us'])} us"


def limb_step(f: Figures) -> Iterable[Row]:
    """Rows of bench-limb-step."""
    for key in (name for name in f if name.endswith("_median_ns")):
        mode = key.removesuffix("_median_ns")
        measured = f"{1e-3 * f[key]:.1f}, {1e-3 * f[f'{mode}_p99_ns']:.1f} us"
        yield f"{mode.upper()}: median, p99", measured, "", None


def methods(f: Figures) -> Iterable[Row]:
    """Rows of bench-methods."""
    for name, m in ((n, m) for n, m in f.items() if n != "run"):
        measured = (
            f"{number(m['median_us'])}, {number(m['p99_us'])} us; "
            f"{number(m['ratio_to_min_norm'])}; {number(m['equilibrium_error_n'])} N; "
            f"{number(m['least_slack_median_n'])} N; "
            f"{number(m['largest_steps_n'][-1])} N"
        )
        what = "median, p99; over min_norm; equilibrium; least slack, median; largest step"
        yield f"`{name}`: {what}", measured, "limits kept, no jump", m["met"]


def workspace(f: Figures) -> Iterable[Row]:
    """Rows of bench-workspace."""
    ratio = number(f["ratio_to_two_cores"])
    what = f"{f['poses']} poses against linear programmes (HiGHS), two cores, times faster"
    yield what, ratio, "at least 100", f["ratio_to_two_cores_met"]
    yield "one pose", f"{number(f['two_workers_us_per_pose'])} us", "", None
    differ = f["disagreements"]
    yield f"of {f['poses_by_programmes']} poses differ", str(differ), "0", differ == 0
    speed = number(f["speedup_of_two_workers"])
    yield "from one to two workers", speed, "at least 1.7", f["speedup_of_two_workers_met"]


def geometry_design(f: Figures) -> Iterable[Row]:
    """Rows of design-geometry."""
    what = "feasible volume over the bench's, by linear programmes"
    yield what, number(f["volume_factor"]), "at least 1.5", f["met"]
    for name in ("bench", "design"):
        volume = number(f[name]["feasible_volume_m3"])
        yield f"feasible volume of the {name}", f"{volume} m³", "", None


def _cases(f: Figures) -> Iterable[tuple[str, Figures]]:
    """What was measured of each programme, beside facts of the run."""
    return ((name, case) for name, case in f.items() if name != "run" and isinstance(case, dict))


def tracking(f: Figures) -> Iterable[Row]:
    """Rows of bench-tracking."""
    for name, case in _cases(f):
        for how in ("feedback", "preview", "preview, mismatch"):
            found = case[how]["sensor"]
            judged = how == "preview, mismatch"
            worst = f", worst {number(found['max'])}" if judged else ""
            limit = f"at most {case['target']:g}" if judged else ""
            what = f"{name}: {how}, rms against the command [N or N m]"
            yield what, number(found["median"]) + worst, limit, case["met"] if judged else None


def tracking_commissioned(f: Figures) -> Iterable[Row]:
    """Rows of bench-tracking with rigs that have been commissioned."""
    for name, case in _cases(f):
        for how, goal, met in (
            ("preview, mismatch", "target", "met"),
            ("learnt, mismatch", "learnt target", "learnt, mismatch, met"),
        ):
            found = case[how]["sensor"]
            measured = f"{number(found['median'])}, worst {number(found['max'])}"
            what = f"{name}: {how.partition(',')[0]}, rms against the command [N or N m]"
            yield what, measured, f"at most {case[goal]:g}", case[met]


def simulation(f: Figures) -> Iterable[Row]:
    """Rows of bench-simulation."""
    spread = f"{f['times_real_time_min']:.0f} to {f['times_real_time_max']:.0f}"
    measured = f"{f['times_real_time_median']:.0f} ({spread})"
    yield "times real time, median", measured, f"at least {f['target']:g}", f["met"]


def realtime(f: Figures) -> Iterable[Row]:
    """Rows of bench-realtime."""
    echo = f"{1e3 * f['echo_median_s']:.2f}, {1e3 * f['echo_p99_s']:.2f} ms"
    yield "plain rclpy echo pair: median, p99", echo, "", None
    yield "late cycles of a bare timer", f"{f['timer_late_percent']:.2f} %", "", None
    for key, name in (("rigid_target", "rigid target"), ("all_bridges", "all bridges")):
        run = f[key]
        trip = f"{1e3 * run['round_trip_median_s']:.2f}, {1e3 * run['round_trip_p99_s']:.2f} ms"
        yield f"{name}: state to command, round trip: median, p99", trip, "", None
        ratio = number(run["round_trip_over_echo"], 2)
        limit = f"at most {run['round_trip_target']:g}"
        yield f"{name}: median over the echo's", ratio, limit, run["round_trip_met"]
        late = f"{run['late_percent']:.2f} %"
        yield f"{name}: late cycles", late, "the timer's + 0.5 points", run["late_met"]
        lost = str(max(run["recorder_lost"].values()))
        yield f"{name}: most that the recorder lost of a topic", lost, "", None
        cpu = ", ".join(f"{node} {share:.0f}" for node, share in run["cpu_percent"].items())
        yield f"{name}: share of a core [%]", cpu, "", None


def demo(f: Figures) -> Iterable[Row]:
    """Rows of the demo: its own table."""
    from cabols_control.run_report.judgement.acceptance import checks

    for check in checks(f):
        yield check.quantity, check.measured, check.expected, check.met


def fast_gains(f: Figures) -> Iterable[Row]:
    """Rows of fast-gains, of the programme that is made of steps."""
    run = f["programs"]["steps"]
    rise, over = run["rise_time_s"], run["overshoot_percent"]
    yield "rise time", f"{rise:.3f} s", "at most 0.12 s", rise <= 0.12
    yield "overshoot", f"{over:.2f} %", "at most 5 %", over <= 5.0
    peak = run["current_peak_a"]
    yield "peak current", f"{peak:.2f} A", "at most 3 A", peak <= 3.0


def transport(f: Figures) -> Iterable[Row]:
    """Rows of bench-transport."""
    for name, t in ((n, t) for n, t in f.items() if n != "run"):
        yield f"{name}: readers killed", str(t["kills"]), "", None
        longest = f"{t['long_calls']}, longest {1e3 * t['longest_call_s']:.0f} ms"
        met = None if "shared" in name.lower() else t["long_calls"] == 0
        target = "" if met is None else "0"
        yield f"{name}: calls of publish() over 10 ms", longest, target, met
        took = f"{1e6 * t['median_call_s']:.0f} us"
        yield f"{name}: median call with four readers", took, "", None
        back = f"{1e3 * t['there_and_back_median_s']:.2f} ms"
        yield f"{name}: there and back", back, "", None


def console(f: Figures) -> Iterable[Row]:
    """Rows of bench-console."""
    share = f["console_cpu_percent"]
    limit = f"at most {f['console_cpu_target_percent']:g} %"
    yield "console with two pages, share of a core", f"{share:.1f} %", limit, f["console_cpu_met"]
    trip = [f[name]["round_trip_median_s"] for name in ("with", "without")]
    met = all(f["loop_met"].values())
    yield "the loop's median, with it over without", number(trip[0] / trip[1]), "unchanged", met


def faults(f: Figures) -> Iterable[Row]:
    """Rows of the fault campaign."""
    yield "trials", str(f["trials"]), "", None
    yield "undetected", str(f["undetected"]), "0", f["undetected"] == 0
    slow = f["slow_to_safe"]
    yield "not safe within 50 ms of detection", str(slow), "0", slow == 0
    longest = 1e3 * max(row["safe_max_s"] for row in f["rows"])
    yield "longest from detection to safe", f"{longest:.0f} ms", "at most 50 ms", longest <= 50.0
    peak = f["peak_tension_n"]
    yield "highest tension", f"{peak:.1f} N", "below 150 N", peak < 150.0


def registration(f: Figures) -> Iterable[Row]:
    """Rows of bench-registration."""
    draws = sum(case["draws"] for case in f["cases"] if case["case"].startswith("pose"))
    band = f"{f['pose_nees_low']:.3f} to {f['pose_nees_high']:.3f}"
    what = f"normalised error squared, {draws} draws over geometries and noises"
    yield what, f"{f['pose_nees_mean']:.3f}", f"its 95 % band, {band}", f["met"]
    inside = f"{f['cases_inside']} of {f['cases_total']}"
    yield "single cases in their own band", inside, "", None
    first = f["cases"][0]
    pose = f"{first['position_sigma_um']:.0f} um, {first['rotation_sigma_urad']:.0f} urad"
    yield f"standard deviation, {first['case']}, {first['noise']} noise", pose, "", None


def stiffness(f: Figures) -> Iterable[Row]:
    """Rows of bench-stiffness."""
    plain, cubic = f["optimal_tensions"], f["cubic"]
    worst = 100.0 * max(plain["largest_error_relative"])
    count = plain["campaigns"]
    what = f"largest error of any joint, {count} simulated campaigns"
    yield what, f"{worst:.2f} %", "at most 2 %", worst <= 2.0
    covered = plain["coverage_95"]
    met = min(covered) >= 0.9 and max(covered) <= 0.98
    yield "95 % intervals cover, joint by joint", f"{span(covered, 100)} %", "90 to 98 %", met
    shares = f"{span(cubic['cubic_mean_of_truth'], 100)} % of truth"
    yield "cubic, hysteretic truth: cubic terms, mean", shares, "", None
    third = f"{span(cubic['published_cubic_mean_of_truth'])} of truth"
    yield "the same, identified as published", third, "1/3 expected", None
    pair = [1e6 * cubic[f"held_out_error_{name}_m"] for name in ("cubic", "linear")]
    lower = cubic["held_out_lower_in_all"]
    yield "held-out loads, cubic, linear", "{:.1f}, {:.1f} um".format(*pair), "lower", lower
    removed = 100.0 * min(case["removed_worst"] for case in f["compensation"])
    what = "deflection that compensation removes, worst load"
    yield what, f"{removed:.1f} %", "at least 95 %", removed >= 95.0


def design(f: Figures) -> Iterable[Row]:
    """Rows of bench-design."""
    what = "loads of ten arbitrary configurations for one of the optimal design, least"
    yield what, number(f["least_ratio"]), "at least 2", f["met"]


def campaign_kills(f: Figures) -> Iterable[Row]:
    """Rows of campaign-kills."""
    met = f["unharmed"] == f["kills"]
    yield "nodes killed (-9) without harm", f"{f['unharmed']} of {f['kills']}", "all", met


def analysis(f: Figures) -> Iterable[Row]:
    """Rows of bench-analysis."""
    longest = f["runs"][-1]["minutes"]
    peak = f"{f['longest_peak_memory_gib']:.2f} GiB"
    yield f"memory, bag of {longest:g} min", peak, "below 1 GiB", f["memory_met"]
    within = f"within {100.0 * f['nonlinearity']:.0f} %"
    yield "time for each cycle, bags of different lengths", within, "linear", f["linear_met"]


BLOCKS = (
    Block(
        "limb_step",
        "bench/limb_step.json",
        "`make bench-limb-step`: the limb controller's step, eight limbs, messages included",
        limb_step,
    ),
    Block(
        "tension",
        "bench/tension.json",
        "`make bench-tension`: redundancy resolution of eight cables, calls taken in turn",
        tension,
    ),
    Block(
        "methods",
        "bench/methods.json",
        "`make bench-methods`: other methods over minimum norm",
        methods,
    ),
    Block(
        "workspace",
        "bench/workspace.json",
        "`make bench-workspace`: poses judged wrench-feasible",
        workspace,
    ),
    Block(
        "geometry_design",
        "bench/geometry_design.json",
        "`make design-geometry`: attachment points, checked by linear programmes",
        geometry_design,
    ),
    Block(
        "tracking",
        "bench/tracking.json",
        "`make bench-tracking`: error against the command, compiled loop, full plant",
        tracking,
    ),
    Block(
        "tracking_commissioned",
        "bench/tracking_commissioned.json",
        "`make bench-tracking-commissioned`: the same of wrong rigs that were commissioned",
        tracking_commissioned,
    ),
    Block(
        "simulation",
        "bench/simulation.json",
        "`make bench-simulation`: the compiled closed loop, full plant, one core",
        simulation,
    ),
    Block(
        "realtime",
        "bench/realtime.json",
        "`make bench-realtime`: 1 kHz, two cores, all nodes and the recorder",
        realtime,
    ),
    Block(
        "demo",
        "demo/summary.json",
        "`make demo`: a session on the simulated rig",
        demo,
    ),
    Block(
        "fast_gains",
        "bench/fast_gains.json",
        "`make fast-gains`: a faster control design, real nodes in lockstep",
        fast_gains,
    ),
    Block(
        "transport",
        "bench/transport.json",
        "`make bench-transport`: what a killed process costs the others",
        transport,
    ),
    Block(
        "console",
        "bench/console.json",
        "`make bench-console`: what the console costs the rig",
        console,
    ),
    Block(
        "faults",
        "faults/faults.json",
        "`make faults`: faults in the loaded rig",
        faults,
    ),
    Block(
        "registration",
        "bench/registration.json",
        "`make bench-registration`: pose from three reflectors",
        registration,
    ),
    Block(
        "stiffness",
        "bench/stiffness.json",
        "`make bench-stiffness`: simulated campaigns, identified",
        stiffness,
    ),
    Block(
        "design",
        "bench/design.json",
        "`make bench-design`: loads that an optimal campaign saves",
        design,
    ),
    Block(
        "campaign_kills",
        "bench/campaign_kills.json",
        "`make campaign-kills`: nodes killed (-9) in turn during short campaigns",
        campaign_kills,
    ),
    Block(
        "analysis",
        "bench/analysis.json",
        "`make bench-analysis`: bags of different lengths",
        analysis,
    ),
)
