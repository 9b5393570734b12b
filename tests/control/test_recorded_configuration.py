# SPDX-License-Identifier: Apache-2.0
"""A bag says what ran: parameters of the nodes, files in force; no secrets."""

from __future__ import annotations

from hashlib import sha256

import yaml

from cabols_control.recorded_configuration import UNREADABLE, configuration_texts
from cabols_control.rig_folder import FILES, find_rig

RIG = find_rig()


def test_every_file_of_the_rig_is_there_with_its_hash():
    texts = configuration_texts(RIG, {})
    for file in FILES:
        if not RIG.has(file.name):
            continue
        stem, _, kind = file.name.partition(".")
        content = (RIG.path / file.name).read_text()
        key = stem if kind == "yaml" else f"{stem}_{kind}"
        assert texts[f"{stem}_{kind}"] == content
        assert texts[f"{key}_file"] == file.name
        assert texts[f"{key}_sha256"] == sha256(content.encode()).hexdigest()
    assert texts["rig"] == "bench"
    assert texts["configuration"] == RIG.fingerprint


def test_a_file_that_a_node_names_stands_in_the_rigs_place(tmp_path):
    other = tmp_path / "tight.yaml"
    other.write_text("a: 1\n")
    for parameter, key in (
        ("safety_file", "safety"),
        ("card_file", "card"),
        ("plant_file", "plant"),
        ("tracker_file", "tracker"),
        ("robot_configurations_file", "robot"),
        ("robot_file", "robot_truth"),
    ):
        texts = configuration_texts(RIG, {"plant": {parameter: str(other)}})
        assert texts[f"{key}_file"] == "tight.yaml"
        assert texts[f"{key}_yaml"] == "a: 1\n"
        assert texts[f"{key}_sha256"] == sha256(b"a: 1\n").hexdigest()


def test_parameters_stand_by_node_and_the_method_in_force_by_name():
    given = {"tension_method": "p_norm", "cpu": 1, "limbs": [0, 1]}
    texts = configuration_texts(RIG, {"wrench_controller": given, "plant": {"seed": 4}})
    assert yaml.safe_load(texts["parameters_wrench_controller"]) == given
    assert yaml.safe_load(texts["parameters_plant"]) == {"seed": 4}
    assert texts["tension_method"] == "p_norm"
    plain = configuration_texts(RIG, {"wrench_controller": {"tension_method": ""}})
    assert "tension_method" not in plain


def test_no_secret_is_copied_and_a_file_of_another_host_is_said(tmp_path):
    secret = tmp_path / "password"
    secret.write_text("hush-hush\n")
    given = {"password_file": str(secret), "token_file": str(secret), "bias_file": "/not/here"}
    texts = configuration_texts(RIG, {"abb_tracker_bridge": given})
    assert "hush-hush" not in "".join(texts.values())
    assert texts["bias_text_file"] == f"/not/here: {UNREADABLE}"
