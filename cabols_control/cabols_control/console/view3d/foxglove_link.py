# SPDX-License-Identifier: Apache-2.0
"""An optional WebSocket for Foxglove: the rig as a scene, and the live values."""

from __future__ import annotations

import math
from typing import Any

from cabols_control.console.view3d.scene import SceneConfig
from cabols_control.console.view3d.shapes import CYLINDER, Shape, rig_shapes
from cabols_control.errors import ConfigError
from cabols_control.rig import Rig

SCENE_TOPIC, LIVE_TOPIC = "/cabols/scene", "/cabols/live"
SCENE_EVERY = 2
"""Frames between two scenes: ten a second."""
AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
LIVE_SCHEMA: dict[str, Any] = {
    "type": "object",
    "title": "cabols.Live",
    "properties": {
        **{
            name: {"type": "array", "items": {"type": "number"}}
            for name in ("tension_n", "asked_tension_n", "current_a", "joints_rad")
        },
        **{
            name: {"type": "object", "properties": {axis: {"type": "number"} for axis in AXES}}
            for name in ("wrench", "desired")
        },
    },
}


def live_message(frame: dict[str, Any]) -> dict[str, Any]:
    """Return a frame with descriptive names; missing values are left out."""

    def known(values: list[float | None]) -> list[float]:
        return [math.nan if value is None else value for value in values]

    found: dict[str, Any] = {}
    for name, key in (
        ("tension_n", "T"),
        ("asked_tension_n", "A"),
        ("current_a", "C"),
        ("joints_rad", "J"),
    ):
        if key in frame and None not in frame[key]:
            found[name] = frame[key]
    for name, key in (("wrench", "w"), ("desired", "d")):
        if key in frame:
            pairs = zip(AXES, known(frame[key]), strict=True)
            found[name] = {axis: value for axis, value in pairs if math.isfinite(value)}
    return found


class FoxgloveLink:
    """Server of foxglove-sdk on loopback; own threads send, and a slow viewer loses messages."""

    def __init__(self, rig: Rig, scene: SceneConfig, host: str, port: int) -> None:
        """Open the WebSocket.

        Raises:
            ConfigError: if the package is missing or the port is taken.
        """
        try:
            import foxglove
            from foxglove.channels import SceneUpdateChannel
        except ImportError as error:
            raise ConfigError(f"foxglove_port: needs the package foxglove-sdk ({error})") from error
        self._rig, self._scene = rig, scene
        self._turns = 0
        # Kept: without it the server drops its channels.
        self._context = context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="cabols", host=host, port=port, context=context, capabilities=[]
            )
        except Exception as error:
            raise ConfigError(
                f"foxglove_port: cannot serve at {host}:{port} ({error}); choose another"
            ) from error
        self._scenes = SceneUpdateChannel(SCENE_TOPIC, context=context)
        self._live = foxglove.Channel(LIVE_TOPIC, schema=LIVE_SCHEMA, context=context)

    @property
    def port(self) -> int:
        """TCP port that is served."""
        return int(self._server.port)

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()

    def send(self, frame: dict[str, Any]) -> None:
        """Log one frame; costs little without a viewer."""
        if self._live.has_sinks():
            self._live.log(live_message(frame))
        self._turns += 1
        if self._turns % SCENE_EVERY == 0 and self._scenes.has_sinks():
            self._scenes.log(scene_update(self._rig, rig_shapes(self._rig, self._scene, frame)))


def scene_update(rig: Rig, shapes: list[Shape]) -> Any:
    """Shapes as Foxglove's SceneUpdate, an entity for each group.

    Args:
        rig: whose base frame the shapes are in.
        shapes: bodies; each entity replaces the one of its group in the scene before.
    """
    from foxglove import messages as fox

    def pose(shape: Shape) -> Any:
        x, y, z, w = map(float, shape.quaternion)
        place = fox.Vector3(**dict(zip("xyz", map(float, shape.position), strict=True)))
        return fox.Pose(position=place, orientation=fox.Quaternion(x=x, y=y, z=z, w=w))

    entities = []
    for group in dict.fromkeys(shape.group for shape in shapes):
        own = [shape for shape in shapes if shape.group == group]
        cylinders, spheres = [], []
        for shape in own:
            red, green, blue = shape.colour
            size = fox.Vector3(x=shape.size[0], y=shape.size[1], z=shape.size[2])
            colour = fox.Color(r=red, g=green, b=blue, a=1.0)
            if shape.kind == CYLINDER:
                cylinders.append(
                    fox.CylinderPrimitive(
                        pose=pose(shape), size=size, bottom_scale=1.0, top_scale=1.0, color=colour
                    )
                )
            else:
                spheres.append(fox.SpherePrimitive(pose=pose(shape), size=size, color=colour))
        entities.append(
            fox.SceneEntity(
                id=group,
                frame_id=rig.geometry.base_frame,
                frame_locked=True,
                cylinders=cylinders,
                spheres=spheres,
            )
        )
    return fox.SceneUpdate(entities=entities)
