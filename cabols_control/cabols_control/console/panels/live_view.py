# SPDX-License-Identifier: Apache-2.0
"""Parts of the page that the script fills: plain HTML with the element names that it uses."""

from __future__ import annotations

from html import escape

from cabols_control.naming import number


def view_html() -> str:
    """Three-dimensional view."""
    return (
        "<h2>Rig</h2>"
        '<div id="view3d" class="view3d"><div class="scale"><span>0 N</span><i></i>'
        '<span>limit</span><span id="view3d-note"></span></div></div>'
    )


def limbs_html(cables: int) -> str:
    """Tensions and currents against their limits, switches and zeros."""
    rows = "".join(_limb(i) for i in range(cables))
    return (
        "<h2>Limbs: tension and motor current against their limits "
        '<span id="feasible" class="why"></span></h2>'
        '<table class="data" aria-label="Limbs"><thead><tr><th scope="col">Limb</th>'
        '<th scope="col" style="width:38%">Tension (white: setpoint)</th>'
        '<th scope="col">Setpoint</th>'
        '<th scope="col" style="width:22%">Current</th><th scope="col">Switch</th>'
        f'<th scope="col">Zero</th></tr></thead><tbody>{rows}</tbody></table>'
    )


def _limb(i: int) -> str:
    return (
        f'<tr><th scope="row">{number(i)}</th>'
        f'<td><div style="display:flex;gap:8px;align-items:center"><div class="gauge" '
        f'style="flex:1"><i id="tb-{i}"></i><b id="tm-{i}"></b><u style="left:calc(100% - 2px)">'
        f'</u></div><span id="t-{i}" class="n" style="width:62px;text-align:right">&ndash;</span>'
        f'<span id="h-{i}" class="badge">HIGH</span></div></td>'
        f'<td class="n" id="a-{i}">&ndash;</td>'
        f'<td><div style="display:flex;gap:8px;align-items:center"><div class="gauge" '
        f'style="flex:1;min-width:36px"><i id="cb-{i}" class="centred" style="left:50%;'
        f'transform-origin:0 50%"></i></div><span id="c-{i}" class="n" '
        f'style="width:58px;text-align:right">&ndash;</span></div></td>'
        f'<td><span id="s-{i}" class="flag">&ndash;</span></td>'
        f'<td><span id="z-{i}" class="flag">&ndash;</span></td></tr>'
    )


def wrench_html() -> str:
    """Desired and measured wrench over time."""
    legend = "".join(
        f'<span style="--c:{colour}">{axis} measured</span>'
        for axis, colour in (("x", "#60a5fa"), ("y", "#4ade80"), ("z", "#fbbf24"))
    )
    return (
        '<p id="wrench-error" class="why" role="status"></p>'
        '<h2>Force on the platform [N], <span id="force-frame">base axes</span></h2>'
        '<canvas id="chart-force" class="chart" role="img" '
        'aria-label="Force over the last 30 seconds, measured and desired"></canvas>'
        '<h2 style="margin-top:10px">Torque [N m] <span id="torque-frame">about the '
        "platform's origin</span></h2>"
        '<canvas id="chart-torque" class="chart" role="img" '
        'aria-label="Torque over the last 30 seconds, measured and desired"></canvas>'
        f'<div class="legend">{legend}<span class="dashed" style="--c:#9fb0bf">desired</span></div>'
    )


def health_html(rig: str) -> str:
    """Devices, loops, and with which configuration they were started.

    Args:
        rig: name and fingerprint; an operator compares it with the bag's and the other nodes'.
    """
    return (
        '<h2>Devices</h2><table class="data small" aria-label="Devices">'
        '<tbody id="devices"></tbody></table>'
        '<h2 style="margin-top:12px">Loops</h2><table class="data small" aria-label="Loops">'
        '<thead><tr><th scope="col">Node</th><th scope="col">State</th>'
        '<th scope="col" style="text-align:right">Hz</th>'
        '<th scope="col" style="text-align:right">late %</th>'
        '<th scope="col" style="text-align:right">trip ms</th></tr></thead>'
        '<tbody id="loops"></tbody></table>'
        f'<p id="rig" class="why">Rig {escape(rig)}</p>'
    )


def log_html() -> str:
    """Events and faults, newest first."""
    return (
        "<h2>Events and faults, newest first</h2>"
        '<div id="log" class="log" role="log" tabindex="0" aria-label="Events and faults"></div>'
    )
