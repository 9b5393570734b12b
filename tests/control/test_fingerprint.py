# SPDX-License-Identifier: Apache-2.0
"""The fingerprint of a rig's files, which /diagnostics shows."""

from __future__ import annotations

import shutil

from cabols_control.rig_folder import find_rig


def test_copies_have_one_fingerprint_and_any_change_another(tmp_path):
    bench = find_rig()
    copy = tmp_path / "copy"
    shutil.copytree(bench.path, copy)
    folder = find_rig(str(copy))
    assert folder.fingerprint == bench.fingerprint
    assert len(folder.fingerprint) == 12
    seen = {folder.fingerprint}
    for name in ("safety.yaml", "card.yaml", "geometry.yaml"):
        with (copy / name).open("a") as file:
            file.write("\n")
        seen.add(folder.fingerprint)
    (copy / "plant.yaml").unlink()
    seen.add(folder.fingerprint)
    assert len(seen) == 5
