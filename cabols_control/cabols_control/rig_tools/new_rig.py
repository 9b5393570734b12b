# SPDX-License-Identifier: Apache-2.0
"""Make the folder of a new rig: a copy of the reference bench's, for 7, 8 or 10 cables.

With `--robot` another arm of six joints holds the platform where the bench's robot does; with
`--hanging` nothing but eight cables does (docs/safety.md).

Never writes into an existing folder. Edit the files, then check them with `check_rig`.
"""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from cabols_control.command_line import DONE, CommandParser, command, existing_path
from cabols_control.errors import UsageError
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import cable_lengths
from cabols_control.rig_folder import BENCH, FILES, find_rig
from cabols_control.rig_tools.new_rig_robot import robot_files

CHANNELS = 8
"""Analog outputs and encoder inputs of one Q8."""
ENABLE_LINE = 8
EIGHT = 8
HANGING = "hanging"
BENCH_SPEED_M_S = 0.06
"""That robot.yaml has where it says none."""
AXIAL_N = 15300.0
"""EA of the bench's cables."""
POINTS = {
    7: (
        [
            [0.9, 1.57, 1.57],
            [-0.87, 1.64, 1.2],
            [-0.53, 0.47, 1.28],
            [0.9, 0.43, 1.59],
            [0.69, 2.03, 0.07],
            [-0.9, 1.89, 0.19],
            [0.5, 0.44, 0.1],
        ],
        [
            [0.022, 0.148, -0.12],
            [0.026, 0.148, -0.023],
            [0.08, -0.127, -0.089],
            [0.023, -0.148, -0.12],
            [0.15, 0.01, 0.071],
            [-0.133, -0.069, 0.108],
            [0.132, -0.071, 0.112],
        ],
    ),
    10: (
        [[0.9, 1.234615, 1.592718], [-0.9, 1.234615, 1.592718]],
        [[0.0, 0.15, -0.1], [0.0, -0.15, -0.1]],
    ),
}
"""Base and platform points [m]: of all seven cables; of those that ten have besides the bench's."""


def make_rig(
    folder: Path,
    cables: int = EIGHT,
    robot: Path | None = None,
    tip: str = "",
    hanging: bool = False,
) -> list[Path]:
    """Copy the bench's files, changed for a number of cables and another robot.

    Args:
        folder: that is made; nothing may be there yet.
        cables: 7, 8 or 10.
        robot: URDF of an arm of six joints in place of the bench's.
        tip: link at that arm's end; empty: the only one, or the flange by its name.
        hanging: copy the rig whose platform hangs on its cables in the bench's place.

    Returns:
        The files.

    Raises:
        UsageError: if the folder exists, or there is no example with this number of cables, or a
            hanging platform would have a robot.
        ConfigError: if the robot's URDF cannot be used, or the arm does not reach a pose.
    """
    if cables != EIGHT and cables not in POINTS:
        raise UsageError(
            f"--cables: expected 7, 8 or 10, of which there are examples, got {cables}; make one "
            "of 8 and write your points into geometry.yaml (docs/your_rig.md)"
        )
    if hanging and (cables != EIGHT or robot is not None):
        raise UsageError(
            "--hanging: the example of a platform that hangs on its cables has eight of them and "
            "no robot; leave --cables and --robot out"
        )
    bench = find_rig(HANGING if hanging else "")
    changed = {} if robot is None else robot_files(bench, robot, tip)
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise UsageError(
            f"{folder}: expected nothing there, got a file or folder; name another one"
        ) from error
    written = []
    for file in FILES:
        if not bench.has(file.name):
            continue
        text = changed.get(file.name) or bench.file(file.name).read_text(encoding="utf-8")
        if file.name == "card.yaml" and not hanging:
            text = _fail_safe(text)
        if cables != EIGHT:
            text = _CHANGES.get(file.name, lambda same, _: same)(text, cables)
        target = folder / file.name
        target.write_text(text, encoding="utf-8")
        written.append(target)
    if cables != EIGHT:
        _springs(folder)
    return written


def _springs(folder: Path) -> None:
    """Write each limb's k_e: the bench's springs, and cables whose lengths differ.

    With one k_e for cables of 1.03 to 1.43 m, of which the longest is 6 % softer, the smallest
    torque steps overshoot by 9 %.
    """
    file = folder / "limbs.yaml"
    text = file.read_text(encoding="utf-8")
    k_e = float(yaml.safe_load(text)["stiffness"])
    bench, new = load_geometry(), load_geometry(folder / "geometry.yaml")
    usual, lengths = (
        cable_lengths(each, each.reference_position, each.reference_rotation)
        for each in (bench, new)
    )
    compliance = 1.0 / k_e + (lengths - usual.mean()) / AXIAL_N
    values = ", ".join(f"{value:.0f}.0" for value in 1.0 / compliance)
    text = re.sub(
        r"(?m)^stiffness: .*$",
        "# k_e of spring and cable at the reference pose [N/m], and EA of the cables [N]: the\n"
        "# springs are the bench's, and a longer cable is softer.\n"
        f"stiffness: [{values}]\naxial_stiffness: {AXIAL_N}",
        text,
    )
    file.write_text(text, encoding="utf-8")


def _fail_safe(text: str) -> str:
    """Wire the switches so that a broken wire pays out: the bench's own file stays as it is."""
    return re.sub(
        r"(?m)^switch_active_low: .*$",
        "switch_active_low: false      # contacts open when the cable pulls: a broken wire reads\n"
        "                              # closed, so that its limb pays out (docs/safety.md)",
        text,
    )


def _geometry(text: str, cables: int) -> str:
    base, platform = POINTS[cables]
    head, _, rest = text.partition("base_points:")
    old_base, _, old_platform = rest.partition("platform_points:")
    keep = cables > EIGHT
    rows = [line for line in old_base.splitlines() if line.lstrip().startswith("- [")]
    more = [line for line in old_platform.splitlines() if line.lstrip().startswith("- [")]
    rows = (rows if keep else []) + [f"  - {point}" for point in base]
    more = (more if keep else []) + [f"  - {point}" for point in platform]
    head = "\n".join(line for line in head.splitlines() if not line.startswith("#"))
    lines = [
        f"# A rig of {cables} cables, an example of this project: write your points here.",
        head.strip(),
        "base_points:                  # m, in the base frame",
        *rows,
        "platform_points:              # m, in the platform frame",
        *more,
    ]
    return "\n".join(lines) + "\n"


def _limbs(text: str, cables: int) -> str:
    def repeat(found: re.Match[str]) -> str:
        values = [value.strip() for value in found[2].split(",")]
        return f"{found[1]}[{', '.join(values[i % len(values)] for i in range(cables))}]"

    text = re.sub(r"(?m)^((?:gain|time_constant): )\[([^]]*)\]", repeat, text)
    return text.replace("Limbs of the reference bench", "Limbs, those of the reference bench again")


def _card(text: str, cables: int) -> str:
    def terminal(index: int) -> str:
        card, channel = divmod(index, CHANNELS)
        return str(channel) if card == 0 else f"{{card: {card}, channel: {channel}}}"

    terminals = ", ".join(terminal(index) for index in range(cables))
    cards = 1 + (cables - 1) // CHANNELS
    enables = [str(ENABLE_LINE)] + [
        f"{{card: {card}, channel: {ENABLE_LINE}}}" for card in range(1, cards)
    ]
    text = re.sub(r"(?m)^(  (?:encoders|switches|motors): )\[[^]]*\]", rf"\1[{terminals}]", text)
    return re.sub(r"(?m)^(  enables: )\[[^]]*\]", rf"\1[{', '.join(enables)}]", text)


def _campaign(text: str, cables: int) -> str:
    def fit(found: re.Match[str]) -> str:
        values = [value.strip() for value in found[1].split(",")]
        return f"peak: [{', '.join([*values, *['6.0'] * cables][:cables])}]"

    text = re.sub(r"peak: \[([^]]*)\]", fit, text)
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    note = (
        "# A campaign whose peaks are those of the reference bench, cut or filled up with 6 N:\n"
        "# they were not searched for this rig (docs/identification.md).\n"
    )
    return (note + "\n".join(lines) + "\n").replace("limbs 1 to 8", f"limbs 1 to {cables}")


def _robot(text: str, cables: int) -> str:
    """Lower the speed where more held cables than the bench's would stretch."""
    if cables <= EIGHT:
        return text
    speed = BENCH_SPEED_M_S * EIGHT / cables
    return (
        f"{text.rstrip()}\nspeed: {speed:.3f}   # m/s, of the platform, in cabols.mod, too: it is "
        f"stiffer held by {cables} cables\n               # than by eight (docs/safety.md)\n"
    )


_CHANGES = {
    "robot.yaml": _robot,
    "geometry.yaml": _geometry,
    "limbs.yaml": _limbs,
    "card.yaml": _card,
    "campaign.yaml": _campaign,
}


@command
def main() -> int:
    """Make the folder; returns 0, or 2 if it exists."""
    parser = CommandParser("new_rig", __doc__)
    parser.add_argument("folder", type=Path, help="that is made; its name is the rig's")
    parser.add_argument("--cables", type=int, default=EIGHT, help="7, 8 or 10 (default: 8)")
    parser.add_argument(
        "--robot",
        type=existing_path,
        metavar="URDF",
        help="another arm, with the bench's base",
    )
    parser.add_argument("--tip", default="", help="link at that arm's end (default: its flange)")
    parser.add_argument(
        "--hanging", action="store_true", help="nothing but eight cables holds the platform"
    )
    options = parser.parse_args()
    for taken in (BENCH, HANGING):
        if options.folder.name == taken:
            raise UsageError(f"{options.folder}: expected a name that is not {taken}, as ours is")
    words = (options.cables, options.robot, options.tip, options.hanging)
    for path in make_rig(options.folder, *words):
        print(f"  {path}")
    what = "that hangs on its cables" if options.hanging else f"of {options.cables} cables"
    run = (
        f"ros2 launch cabols_sim bench.launch.py rig:={options.folder.resolve()}"
        if options.hanging
        else f'make demo ARGS="--rig {options.folder}"'
    )
    print(
        f"a rig {what} with our example's numbers: write yours, then "
        f"`ros2 run cabols_sim check_rig {options.folder}` and `{run}`"
    )
    return DONE


if __name__ == "__main__":
    raise SystemExit(main())
