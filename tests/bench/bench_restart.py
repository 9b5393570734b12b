# SPDX-License-Identifier: Apache-2.0
"""Restarts of the bridge with 10 to 100 N on the gears, 20 times each, with and without a bias.

Prints a table and writes build/bench/restart.json; returns 1 if a wrench was wrong by more than
1 N or 0.1 N m, or fewer than 90 % of the restarts with a bias were usable without a person.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from cabols_sim.fault_campaign.in_process.restarts import HELD_N, restart_row, restart_trial
from cabols_sim.fault_campaign.in_process.trials import Bench

USABLE = 0.9


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="restarts of each (%(default)s)")
    parser.add_argument("--output", type=Path, default=Path("build/bench/restart.json"))
    options = parser.parse_args()
    bench, rows = Bench(), []
    print("load on the gears   bias kept   usable    wrong   largest error")
    for bias_kept in (True, False):
        for held_n in HELD_N:
            row = restart_row(
                [restart_trial(bench, held_n, seed, bias_kept) for seed in range(options.seeds)]
            )
            rows.append(row)
            print(
                f"{held_n:11.0f} N {row['bias_kept']!s:>16} {row['usable']:5d}/{row['trials']:<3d} "
                f"{row['wrong']:5d}   {row['error_max_n']:.2f} N, {row['error_max_nm']:.3f} N m",
                flush=True,
            )
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(rows, indent=2) + "\n", "utf-8")
    print(f"  {options.output}")
    kept = [row for row in rows if row["bias_kept"]]
    usable = sum(row["usable"] for row in kept) >= USABLE * sum(row["trials"] for row in kept)
    return 0 if kept and usable and not any(row["wrong"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
