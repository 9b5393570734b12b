# SPDX-License-Identifier: Apache-2.0
"""Parsers of text: YAML, rig files, .cal, programmes, tables, maps, journals, biases, URDF."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from engine import Target
from oracles import DECIMAL, check, csv_rows, decimal, equal, finite, only_finite, same_yaml
from ruamel.yaml import YAML
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.error import YAMLError

from cabols_control.bags.metadata import read_metadata
from cabols_control.errors import CabolsError
from cabols_control.files.strict_yaml import parse
from cabols_control.geometry import load_geometry
from cabols_control.load_programs.programs import CSV_HEADER, multi_axis, parse_csv
from cabols_control.rig import load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.serial_arms.arm import read_serial_arm
from cabols_control.workspace.bodies import load_bodies
from cabols_control.workspace.tool.files import POSE_COLUMNS, read_poses
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.card.config import load_card
from cabols_hw.force_torque.ati import parse_calibration
from cabols_hw.force_torque.sensor_bias import load_bias
from cabols_hw.safety.config import load_safety
from cabols_hw.tracker.config import load_tracker_config
from cabols_stiffness.campaign.journal import LOG_COLUMNS, read_log, read_samples
from cabols_stiffness.campaign.plan import load_plan
from cabols_stiffness.measurements.measured_load import columns, to_cells
from cabols_stiffness.table.reading import NOTHING, read_table

COLON_IN_FLOW = re.compile(r"[{\[,][^\n]*:[^\s]")
SHORT = (
    b"a: 1\nb: [1.5, -2e3, .inf]\nc: {d: true, e: text}\n",
    b"x: &p {y: 1}\nz: *p\nw:\n  - 0\n  - 1e6\n  - ~\n",
    b"text: |\n  lines\n  of it\nother: 'quoted: 1'\nlast: \"\\u00e9\"\n",
    b"base: &b {m: 3}\nmore:\n  <<: *b\n  n: 4\n",
)
RIG = {
    "geometry.yaml": load_geometry,
    "safety.yaml": lambda path: load_safety(path=path),
    "card.yaml": lambda path: load_card(path=path),
    "tracker.yaml": lambda path: load_tracker_config(path=path),
    "robot.yaml": lambda path: load_configurations(path=path),
    "campaign.yaml": load_plan,
    "bodies.yaml": lambda path: load_bodies(path=path),
    "limbs.yaml": lambda path: load_rig(limbs=path),
    "control.yaml": lambda path: load_rig(control=path),
}


def scratch(name: str) -> Path:
    """A file in memory, as the readers want one."""
    place = "/dev/shm" if Path("/dev/shm").is_dir() else None
    return Path(tempfile.mkdtemp(prefix="cabols_fuzz_", dir=place)) / name


def decoded(data: bytes) -> str:
    """Text as a file's reader has it; bytes that are no text stand for themselves."""
    return data.decode("utf-8", "surrogateescape")


def rig_text(name: str) -> bytes:
    """A file of the bench without its comments."""
    lines = find_rig().file(name).read_text("utf-8").splitlines()
    bare = [re.sub(r"\s+#.*", "", line) for line in lines if not line.startswith("#")]
    return "\n".join([*bare, ""]).encode()


def open_yaml() -> Callable[[bytes], bool]:
    """The rule book of rig files, beside ruamel.yaml's reader of YAML 1.2."""
    other = YAML(typ="safe", pure=True)

    def feed(data: bytes) -> bool:
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            return False
        try:
            found = parse(text).content
        except CabolsError:
            return False
        if COLON_IN_FLOW.search(text):
            # `{a:b:}`: the readers of YAML do not agree on what is key and what is value.
            return True
        other.doc_infos.clear()  # else it keeps something of every document
        try:
            theirs = other.load(text)
        except DuplicateKeyError:
            check(right=False, what="yaml: took a key twice")
        except (YAMLError, ValueError, TypeError, AttributeError, NotImplementedError, KeyError):
            return True
        same_yaml(found, theirs)
        return True

    return feed


def open_rig() -> Callable[[bytes], bool]:
    """Files of a rig's folder by their own readers."""
    path = scratch("rig.yaml")

    def feed(data: bytes) -> bool:
        head, _, body = data.partition(b"\n")
        load: Any = RIG.get(head[2:].decode("latin-1"), load_geometry)
        path.write_bytes(body)
        try:
            found = load(path)
        except CabolsError:
            return False
        only_finite(found, "rig")
        return True

    return feed


def open_cal() -> Callable[[bytes], bool]:
    """.cal files; rows must be those of the file times one factor for forces, one for torques."""

    def feed(data: bytes) -> bool:
        try:
            found = parse_calibration(data, "fuzzed")
        except CabolsError:
            return False
        finite(found.matrix, "cal")
        calibration = ElementTree.fromstring(data).find("Calibration")
        assert calibration is not None
        axes = {axis.get("Name"): axis for axis in calibration.findall("UserAxis")}
        if axes:
            for first in (0, 3):
                names = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")[first : first + 3]
                cells = [axes[name].get("values", "").split() for name in names]
                rows = [[decimal(cell, "cal") for cell in row] for row in cells]
                part = found.matrix[first : first + 3]
                factor = part.ravel()[np.abs(rows).argmax()] / np.ravel(rows)[np.abs(rows).argmax()]
                close = np.allclose(part, factor * np.array(rows), rtol=1e-9, atol=0.0)
                check(close, "cal: other rows than the file's")
                for row, name in enumerate(names):
                    most = decimal(axes[name].get("max", "").strip(), "cal: max")
                    equal(found.limits[first + row], factor * most, "cal: max")
        return True

    return feed


def open_program() -> Callable[[bytes], bool]:
    """Load programmes beside the csv module."""

    def feed(data: bytes) -> bool:
        text = decoded(data)
        try:
            found = parse_csv(text, "fuzzed", "fuzzed.csv")
        except CabolsError:
            return False
        rows = csv_rows(text)[1:]
        check(len(rows) == found.time.size, "programme: another number of rows")
        for k, row in enumerate(rows):
            for cell, value in zip(row, (found.time[k], *found.wrench[k]), strict=True):
                equal(value, decimal(cell.strip(" \t"), "programme"), "programme")
        finite(found.sample(np.linspace(0.0, found.duration, 7)), "programme: sampled")
        return True

    return feed


def programs() -> list[bytes]:
    """Good programmes."""
    built = multi_axis()
    head = ",".join(CSV_HEADER)
    rows = [
        ",".join(repr(float(v)) for v in (t, *w))
        for t, w in zip(built.time, built.wrench, strict=True)
    ]
    text = "\n".join([head, *rows[:5], ""])
    return [
        text.encode(),
        text.replace("\n", "\r\n").encode(),
        (head + '\n0,0,0,0,0,0,0\n1.5,"1",2e1,-3, 4,.5,6.\n\n2,0,0,0,0,0,0').encode(),
    ]


TABLE_HEAD = (
    ["config", "load"] + [f"q{j}_deg" for j in range(1, 7)] + ["fx_N", "fy_kN", "mz_Nmm"]
    + ["dx_mm", "dy_um", "dz_m"]
)  # fmt: skip
DEGREE = np.pi / 180.0
TABLE_FACTORS = [1.0, 1.0] + [DEGREE] * 6 + [1.0, 1e3, 1e-3] + [1e-3, 1e-6, 1.0]
TABLE_ROLES = ["configuration", "load"] + [f"q{j}" for j in range(1, 7)] + [
    "fx", "fy", "mz", "dx", "dy", "dz"]  # fmt: skip


def tables() -> list[bytes]:
    """Good tables of a laboratory, with commas and semicolons."""
    rng = np.random.default_rng(3)
    rows = [
        [str(k // 2), str(k % 2), *(f"{v:.6g}" for v in rng.normal(0, 30, 12))] for k in range(4)
    ]
    rows[2][9] = ""
    text = "\n".join(",".join(row) for row in [TABLE_HEAD, *rows]) + "\n"
    lines = [";".join(f'"{cell}"' for cell in row) for row in [TABLE_HEAD, *rows]]
    texts = (text, text.replace(",", "\t"), "\n".join(lines) + "\n", "# made\n" + text)
    return [made.encode() for made in texts]


def _once_only(rows: list[list[str]]) -> list[list[str]]:
    """Rows without those that repeat an earlier loaded one, number for number."""
    kept, seen = [], set()
    for row in rows:
        cells = [cell.strip().lower() for cell in row[2:]]
        numbers = tuple(None if c in NOTHING else decimal(c, "table") for c in cells)
        if numbers in seen:
            continue
        if any(numbers[6:9]):
            seen.add(numbers)
        kept.append(row)
    return kept


def _are_names(rows: list[list[str]], index: int) -> bool:
    """Whether a column of indices has a word that is no number: then all of its words are names."""
    words = [row[index].strip() for row in rows]
    odd = [w for w in words if w.lower() not in NOTHING and not DECIMAL.fullmatch(w)]
    return any(letter.isalpha() for word in odd for letter in word)


def _same_groups(words: list[str], numbers: Any) -> None:
    """Rows of one name must have one number, and of another name another one."""
    pairs = {(w, float(n)) for w, n in zip(words, numbers, strict=True) if w.lower() not in NOTHING}
    for side in (0, 1):
        check(len({pair[side] for pair in pairs}) == len(pairs), "table: names were mixed")


def open_table() -> Callable[[bytes], bool]:
    """Tables of measured loads beside the csv module."""
    path = scratch("table.csv")

    def feed(data: bytes) -> bool:
        path.write_bytes(data)
        try:
            found = read_table(path, 6)
            for role in ("configuration", "load"):
                found.index(role)
        except CabolsError:
            return False
        text = data.decode("utf-8-sig")
        lines = text.replace("\r\n", "\n").split("\n")
        text = "\n".join(x for x in lines if x.strip() and not x.startswith(("#", "%")))
        mark = max(",;\t", key=text.partition("\n")[0].count)
        rows = csv_rows(text, mark)
        if [cell.strip() for cell in rows[0]] != TABLE_HEAD or found.unread:
            finite(found.joints, "table")
            return True
        good = [row for row in rows[1:] if all(c.strip().lower() not in NOTHING for c in row[2:11])]
        once = _once_only(good)
        check(len(good) - len(once) == len(found.repeated), "table: another number of repetitions")
        good = once
        check(len(good) == len(found), "table: another number of rows")
        named = [role for k, role in enumerate(TABLE_ROLES[:2]) if _are_names(rows[1:], k)]
        for role in named:
            words = [row[TABLE_ROLES.index(role)].strip() for row in good]
            _same_groups(words, found.columns[role])
        for index, role in enumerate(TABLE_ROLES):
            if role in named:
                continue
            for row, value in zip(good, found.columns[role], strict=True):
                cell = row[index].strip()
                if cell.lower() in NOTHING:
                    check(bool(np.isnan(value)), "table: a value for an empty cell")
                else:
                    equal(value, TABLE_FACTORS[index] * decimal(cell, "table"), "table")
        for index, role in enumerate(("configuration", "load")):
            if role in named:
                continue
            for row, whole in zip(good, found.index(role), strict=True):
                cell = row[index].strip()
                if cell.lower() not in NOTHING:
                    check(decimal(cell, "table") == whole, "table: an index that was rounded")
        return True

    return feed


def open_poses() -> Callable[[bytes], bool]:
    """Trajectories for the workspace beside the csv module."""
    path = scratch("poses.csv")

    def feed(data: bytes) -> bool:
        path.write_bytes(data)
        try:
            positions, rotations = read_poses(path)
        except CabolsError:
            return False
        finite(positions, "poses")
        turn = rotations @ np.swapaxes(rotations, 1, 2)
        check(bool(np.allclose(turn, np.eye(3), atol=1e-9)), "poses: no rotation")
        rows = csv_rows(data.decode("utf-8"))
        if tuple(rows[0]) == POSE_COLUMNS:
            check(len(rows) - 1 == len(positions), "poses: another number of rows")
            for row, point in zip(rows[1:], positions, strict=True):
                for cell, value in zip(row[:3], point, strict=True):
                    equal(value, decimal(cell.strip(), "poses"), "poses")
                for cell in row[3:6]:
                    decimal(cell.strip(), "poses")
        return True

    return feed


def journals() -> list[bytes]:
    """Good samples.csv of 8 and 7 limbs."""
    made = []
    rng = np.random.default_rng(5)
    for limbs in (8, 7):
        head = columns(limbs)
        rows = []
        for k in range(3):
            whole = [0, k % 2, k, 0, 1, 10 + k, 20 + k, 5]
            rows.append(
                [str(v) for v in whole] + [repr(float(v)) for v in rng.normal(0, 1, len(head) - 8)]
            )
        made.append(("\n".join(",".join(row) for row in [head, *rows]) + "\n").encode())
    return made


def open_journal() -> Callable[[bytes], bool]:
    """samples.csv of a campaign beside the csv module."""
    folder = scratch("samples.csv").parent

    def feed(data: bytes) -> bool:
        (folder / "samples.csv").write_bytes(data)
        try:
            loads = read_samples(folder)
        except CabolsError:
            return False
        whole = data[: data.rfind(b"\n") + 1].decode("utf-8")
        rows = csv_rows(whole)[1:]
        distinct = {(row[3], row[2]) for row in rows}
        check(len(distinct) == len(loads), "journal: another number of loads")
        for load in loads:
            cells = to_cells(load)
            finite(load.tension, "journal")
            finite(load.average.wrench, "journal")
            finite(load.position, "journal")
            same = [
                row
                for row in rows
                if int(row[2]) == load.load
                and int(row[3]) == load.group
                and all(
                    float(a) == float(b) and decimal(b.strip(" \t"), "journal") == float(b)
                    for a, b in zip(cells, row, strict=True)
                )
            ]
            check(bool(same), "journal: a load that no line holds")
        return True

    return feed


def open_log() -> Callable[[bytes], bool]:
    """log.csv of a campaign."""
    folder = scratch("log.csv").parent

    def feed(data: bytes) -> bool:
        (folder / "log.csv").write_bytes(data)
        try:
            rows = read_log(folder)
        except CabolsError:
            return False
        check(all(isinstance(key, str) for row in rows for key in row), "log: keys")
        return True

    return feed


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    check(len({key for key, _ in pairs}) == len(pairs), "bias: took a key twice")
    return dict(pairs)


def open_bias() -> Callable[[bytes], bool]:
    """The sensor's bias file beside the json module."""
    path = scratch("bias.json")

    def feed(data: bytes) -> bool:
        path.write_bytes(data)
        try:
            found = load_bias(path, "FT1")
        except CabolsError:
            return False
        assert found is not None
        content = json.loads(data.decode("utf-8"), object_pairs_hook=_once)
        for name, values in (("volts", found.volts), ("tare_weight", found.tare_weight)):
            plain = [v for v in content[name] if type(v) in (int, float)]
            check(len(plain) == 6, f"bias: {name}: no numbers")
            check(plain == list(values), f"bias: {name}: other values")
        check(type(content["time_ns"]) is int, "bias: time is no whole number")
        check(content["time_ns"] == found.time_ns >= 0, "bias: another time")
        return True

    return feed


def biases() -> list[bytes]:
    """Good bias files."""
    content = {
        "form": 1, "serial": "FT1", "time_ns": 1790000000000000000,
        "volts": [0.1, -0.2, 0.3, -0.4, 0.5, 1e-3], "tare_weight": [0, 0, -12.5, 0.1, 0, 0.0],
    }  # fmt: skip
    return [json.dumps(content).encode(), json.dumps(content, indent=1).encode()]


def open_urdf() -> Callable[[bytes], bool]:
    """URDF of an arm beside pinocchio's own reader: the flange must be where that one has it."""
    import pinocchio as pin

    path = scratch("robot.urdf")
    angles = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])

    def feed(data: bytes) -> bool:
        path.write_bytes(data)
        try:
            arm = read_serial_arm(path)
        except CabolsError:
            return False
        finite(arm.origins, "urdf")
        finite(arm.axes, "urdf")
        try:
            root = ElementTree.fromstring(data)
        except ElementTree.ParseError:
            # A prefix without its namespace, as xacro leaves some: ours takes it for a name.
            return True
        children = [j.find("child") for j in root.findall("joint")]
        links = [c.get("link") for c in children if c is not None]
        check(len(set(links)) == len(links), "urdf: two joints carry one link")
        check(len(set(arm.joints)) == len(arm.joints), "urdf: two joints of one name")
        try:
            model = pin.buildModelFromXML(data.decode("utf-8"))
        except (ValueError, RuntimeError, UnicodeDecodeError, TypeError):
            return True
        if any(not model.existJointName(name) for name in arm.joints):
            return True
        if model.nq != len(arm.joints) or model.nq > 6 or not model.existFrame(arm.flange):
            return True
        q = angles[: model.nq]
        order = [model.joints[model.getJointId(name)].idx_q for name in arm.joints]
        at = np.zeros(model.nq)
        at[order] = q
        store = model.createData()
        pin.framesForwardKinematics(model, store, at)
        theirs = store.oMf[model.getFrameId(arm.flange)].translation
        check(bool(np.allclose(_flange(arm, q), theirs, atol=1e-9)), "urdf: another flange")
        return True

    return feed


def _flange(arm: Any, q: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    position, rotation = np.zeros(3), np.eye(3)
    for k, angle in enumerate(q):
        position = position + rotation @ arm.origins[k]
        turn = Rotation.from_rotvec(angle * arm.axes[k]).as_matrix()
        rotation = rotation @ arm.rotations[k] @ turn
    return position + rotation @ arm.flange_position


def open_metadata() -> Callable[[bytes], bool]:
    """metadata.yaml of a bag."""
    folder = scratch("metadata.yaml").parent

    def feed(data: bytes) -> bool:
        (folder / "metadata.yaml").write_bytes(data)
        try:
            found = read_metadata(folder)
        except CabolsError:
            return False
        check(isinstance(found, dict), "metadata: no mapping")
        return True

    return feed


def metadata() -> list[bytes]:
    """metadata.yaml of the corpus."""
    here = Path(__file__).resolve().parent.parent / "corpus" / "bags"
    return [path.read_bytes() for path in sorted(here.glob("*/metadata.yaml"))[:12]]


def rig_files() -> list[bytes]:
    """The bench's files, each with its name in its first line."""
    return [f"# {name}\n".encode() + rig_text(name) for name in RIG]


POSES = (
    ",".join(POSE_COLUMNS).encode() + b"\n0.1,0.2,0.3,10,-20,30\n0,0,1e-1,0,0,-1.5e1\n",
    b'rx_deg,ry_deg,rz_deg,x_m,y_m,z_m,note\n0,0,0,1,2,3,"a\nb"\n',
)
LOG = (
    ",".join(LOG_COLUMNS).encode() + b'\n5,retried,0,1,2,"beam, broken"\n9,skipped,0,1,2,x\n',
    b"time_ns,what,configuration,reflector,load,reason\n5,retried,0,1,2,old\n",
)


def urdfs() -> list[bytes]:
    """The bench's arm."""
    text = find_rig().file("robot.urdf").read_text("utf-8")
    bare = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    return [bare.encode(), re.sub(r">\s+<", "><", bare).encode()]


def cals() -> list[bytes]:
    """The bench's calibration and the corpus's."""
    here = Path(__file__).resolve().parent.parent / "corpus" / "cal"
    return [find_rig().file("sensor.cal").read_bytes()] + [
        path.read_bytes() for path in sorted(here.glob("*.cal"))
    ]


TARGETS = (
    Target("yaml", lambda: [*SHORT, rig_text("limbs.yaml")], open_yaml, text=True),
    Target("rig_files", rig_files, open_rig, text=True),
    Target("cal", cals, open_cal, text=True),
    Target("programme_csv", programs, open_program, text=True),
    Target("table_csv", tables, open_table, text=True),
    Target("poses_csv", lambda: list(POSES), open_poses, text=True),
    Target("journal", journals, open_journal, text=True),
    Target("journal_log", lambda: list(LOG), open_log, text=True),
    Target("sensor_bias", biases, open_bias, text=True),
    Target("urdf", urdfs, open_urdf, text=True),
    Target("bag_metadata", metadata, open_metadata, text=True),
)
