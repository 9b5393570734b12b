# SPDX-License-Identifier: Apache-2.0
"""The workspace as ROS sees it: package types, dependencies, installation, who imports whom."""

import ast
import configparser
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from catkin_pkg.package import Package, parse_package

ROOT = Path(__file__).resolve().parents[2]
PREFIX = Path(sys.prefix)
PACKAGES = {path.parent.name: path.parent for path in sorted(ROOT.glob("cabols_*/package.xml"))}
PYTHON_PACKAGES = sorted(name for name, path in PACKAGES.items() if (path / "setup.cfg").exists())

# The table "may import" of the design.
MAY_IMPORT = {
    "cabols_msgs": set(),
    "cabols_control": {"cabols_msgs"},
    "cabols_hw": {"cabols_control", "cabols_msgs"},
    "cabols_sim": {"cabols_hw", "cabols_control", "cabols_msgs"},
    "cabols_stiffness": {"cabols_control", "cabols_msgs"},
}
SPDX = "# SPDX-License-Identifier: Apache-2.0"
ROS_FOLDERS = {"nodes", "ros", "launch"}
ROS_ONLY_THERE = {"rclpy", "cabols_msgs"}

# Module -> key in rosdep's database; ROS packages are keys of their own name.
ROSDEP_KEY = {
    "bokeh": "python3-bokeh-pip",
    "defusedxml": "python3-defusedxml",
    "google": "python3-protobuf",
    "grpc": "python3-grpcio",
    "jinja2": "python3-jinja2",
    "llvmlite": "python3-numba",  # which needs it
    "matplotlib": "python3-matplotlib",
    "mpl_toolkits": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "psutil": "python3-psutil",
    "pydantic": "python3-pydantic",
    "requests": "python3-requests",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
}
ROS_PACKAGES = {
    "action_msgs",
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "launch",
    "launch_ros",
    "lifecycle_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosidl_runtime_py",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "unique_identifier_msgs",
    "visualization_msgs",
    *MAY_IMPORT,
}
# From pip or the vendor: docs/installing.md.
WITHOUT_KEY = {
    "abb_robot_client",
    "daqp",
    "dask",
    "distributed",
    "fastapi",
    "foxglove",
    "lz4",
    "mcap",
    "nicegui",
    "pinocchio",
    "quanser",
    "starlette",
    "uvicorn",
    "zstandard",
}


WITHOUT_ROS = {"cabols_control", "cabols_stiffness"}
"""Packages that pip alone installs."""
PIP_NAME = {
    "foxglove": "foxglove-sdk",
    "fastapi": "nicegui",
    "starlette": "nicegui",
    "uvicorn": "nicegui",
    "mpl_toolkits": "matplotlib",
    "yaml": "pyyaml",
}
"""Modules that pip knows by another name, or that another package brings."""


def sources(package: str) -> list[Path]:
    """Return a package's Python files, launch files among them, without setup.py and test/."""
    folder = PACKAGES[package]
    return [
        path
        for path in sorted(folder.rglob("*.py"))
        if path != folder / "setup.py" and path.relative_to(folder).parts[0] != "test"
    ]


def imported_modules(path: Path) -> set[str]:
    """Return the full names of the modules that a file imports absolutely, at any depth."""
    tree = ast.parse(path.read_text(), str(path))
    return {name for node in ast.walk(tree) for name in _imported(node)}


def _imported(node: ast.AST) -> set[str]:
    """Return the full names of the modules that one statement imports absolutely."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names}
    if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
        return {f"{node.module}.{alias.name}" for alias in node.names}
    return set()


def top_level(path: Path) -> set[str]:
    """Return the top-level names that a file imports."""
    return {name.split(".")[0] for name in imported_modules(path)}


def manifest(package: str) -> Package:
    """Parse a package's package.xml as ROS's tools do; an invalid one raises."""
    return parse_package(str(PACKAGES[package] / "package.xml"))


def dependencies(package: str) -> set[str]:
    """Return the keys that a package needs when it runs."""
    found = manifest(package)
    return {depend.name for depend in [*found.exec_depends, *found.build_export_depends]}


def executables(package: str) -> list[str]:
    """Return the names of a package's console scripts, from its setup.cfg."""
    config = configparser.ConfigParser()
    config.read(PACKAGES[package] / "setup.cfg")
    scripts = config.get("options.entry_points", "console_scripts", fallback="")
    return [line.split("=")[0].strip() for line in scripts.splitlines() if "=" in line]


def place(path: Path) -> str:
    """Return where a file is, for a failure's message."""
    return str(path.relative_to(ROOT))


def test_colcon_sees_ament_packages():
    """An invalid e-mail in package.xml silently makes a plain Python package of an ament one."""
    command = [str(PREFIX / "bin/colcon"), "--log-base", os.devnull, "list"]
    listed = subprocess.run(
        [*command, "--base-paths", *map(str, PACKAGES.values())],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    ).stdout
    types = {name: kind for name, _, kind in (line.split("\t") for line in listed.splitlines())}
    expected = dict.fromkeys(PYTHON_PACKAGES, "(ros.ament_python)")
    assert types == {**expected, "cabols_msgs": "(ros.ament_cmake)"}


def test_colcon_finds_every_package_from_the_root():
    """No stray setup.py or ignore file hides a package from a plain `colcon build`."""
    listed = subprocess.run(
        [str(PREFIX / "bin/colcon"), "--log-base", os.devnull, "list", "--names-only"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    ).stdout
    assert sorted(listed.split()) == sorted(PACKAGES)


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_is_valid_and_agrees_with_setup_cfg(package):
    found = manifest(package)
    assert found.name == package
    assert found.package_format == 3
    if package in PYTHON_PACKAGES:
        config = configparser.ConfigParser()
        config.read(PACKAGES[package] / "setup.cfg")
        assert config["metadata"]["name"] == package
        assert config["metadata"]["version"] == found.version


def test_all_packages_have_one_version():
    assert len({manifest(package).version for package in PACKAGES}) == 1


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_every_import_is_a_declared_dependency(package):
    declared = dependencies(package)
    undeclared, unknown = [], []
    for path in sources(package):
        for name in top_level(path) - set(sys.stdlib_module_names) - WITHOUT_KEY - {package}:
            key = name if name in ROS_PACKAGES else ROSDEP_KEY.get(name)
            if key is None:
                unknown.append(f"{place(path)}: {name}")
            elif key not in declared:
                undeclared.append(f"{place(path)}: {name} needs <exec_depend>{key}</exec_depend>")
    assert not unknown, "modules that this test's ROSDEP_KEY does not know"
    assert not undeclared


def pip_requirements(package: str, extras: bool) -> set[str]:
    """Return the names that pip installs with a package, with its extras or without."""
    config = configparser.ConfigParser()
    config.read(PACKAGES[package] / "setup.cfg")
    texts = [config.get("options", "install_requires")]
    if extras:
        texts += config["options.extras_require"].values()
    return {re.split(r"[<>=\[]", word)[0].lower() for text in texts for word in text.split()}


@pytest.mark.parametrize("package", sorted(WITHOUT_ROS))
def test_pip_brings_what_a_package_imports_without_ros(package):
    """The console's and optional modules by an extra; what is imported at once without one."""
    known = set(sys.stdlib_module_names) | {package}
    at_once, at_all = pip_requirements(package, False), pip_requirements(package, True)
    missing = []
    for path in sources(package):
        folders = set(path.relative_to(PACKAGES[package]).parts[:-1])
        if folders & {*ROS_FOLDERS, "bringup"}:
            continue
        first = {
            name.split(".")[0]
            for statement in ast.parse(path.read_text()).body
            for name in _imported(statement)
        }
        for name in top_level(path) - known:
            wanted = at_once if name in first and "console" not in folders else at_all
            if PIP_NAME.get(name, name).lower() not in wanted:
                missing.append(f"{place(path)}: {name}")
    assert not missing


@pytest.mark.parametrize("package", PACKAGES)
def test_package_is_in_the_ament_index(package):
    assert (PREFIX / "share/ament_index/resource_index/packages" / package).is_file()
    assert (PREFIX / "share" / package / "package.xml").is_file()


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_executables_are_where_ros2_run_looks(package):
    folder = PREFIX / "lib" / package
    installed = {path.name for path in folder.glob("*") if os.access(path, os.X_OK)}
    assert installed == set(executables(package))


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_ros_is_imported_only_by_nodes_conversions_and_launch_files(package):
    found = [
        f"{place(path)}: {sorted(top_level(path) & ROS_ONLY_THERE)}"
        for path in sources(package)
        if top_level(path) & ROS_ONLY_THERE
        and not ROS_FOLDERS & set(path.relative_to(PACKAGES[package]).parts[:-1])
    ]
    assert not found


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_pure_modules_import_no_ros_folder(package):
    """A computation that reaches into nodes/ or ros/ would bring in rclpy by the back door."""
    found = [
        f"{place(path)}: {name}"
        for path in sources(package)
        if not ROS_FOLDERS & set(path.relative_to(PACKAGES[package]).parts[:-1])
        for name in sorted(imported_modules(path))
        if name.startswith("cabols_") and ROS_FOLDERS & set(name.split(".")[1:])
    ]
    assert not found


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_packages_import_only_what_the_design_allows(package):
    """Launch files may start any package's nodes, so they may name any."""
    allowed = MAY_IMPORT[package] | {package}
    found = [
        f"{place(path)}: {name}"
        for path in sources(package)
        if "launch" not in path.relative_to(PACKAGES[package]).parts
        for name in sorted(top_level(path))
        if name.startswith("cabols_") and name not in allowed
    ]
    assert not found


def test_only_tests_examples_tools_and_launch_files_import_the_simulator():
    skipped = {"tests", "examples", "tools", "cabols_sim", "launch"}
    found = [
        place(path)
        for path in ROOT.rglob("*.py")
        if not any(part.startswith(".") for part in path.relative_to(ROOT).parts)
        and path.relative_to(ROOT).parts[0] not in {"build", "install"}
        and not skipped & set(path.relative_to(ROOT).parts)
        and "cabols_sim" in top_level(path)
    ]
    assert not found


def test_every_package_declares_a_typed_interface():
    for package in PYTHON_PACKAGES:
        assert (PACKAGES[package] / package / "py.typed").is_file()
        assert list(PREFIX.glob(f"lib/python3.*/site-packages/{package}/py.typed"))


def test_every_source_names_its_licence():
    """By an SPDX line (ISO/IEC 5962) among the first two, as tools for licences read it."""
    folders = [*PACKAGES, "tests", "tools"]
    sources = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    texts = {
        path: path.read_text(encoding="utf-8")
        for path in sources
        if not path.name.endswith(("_pb2.py", "_pb2_grpc.py"))
    }
    assert len(texts) > 900
    bare = [
        p.name for p, text in texts.items() if text.strip() and SPDX not in text.split("\n")[:2]
    ]
    assert not bare, f"begin them with {SPDX}"
