"""The two links in motion: foot and body on the tilting ground, contact and external forces as arrows, the CoP.

Drawn in the world's frame: on a slope the ground turns and gravity stays; elsewhere the ground is level. The external
force is drawn twice as long as the contact forces; a foot that has lost contact is drawn in red.
"""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from design.analysis.simulate import Trajectory
from design.model.body import Biped
from design.present.plots import BLUE, GREY, ORANGE, RED, canvas, heading

if TYPE_CHECKING:
    from design.present.plots import Axes

FRAMES_PER_SECOND = 15
MOST_FRAMES = 240


def gif_bytes(biped: Biped, run: Trajectory) -> bytes:
    """A GIF of ``run`` in real time, or faster where it would have more than ``MOST_FRAMES`` frames."""
    from PIL import Image

    end = float(run.t[-1])
    count = int(np.clip(round(end * FRAMES_PER_SECOND), 2, MOST_FRAMES))
    figure, axes = canvas(4.2, 4.6)
    ax = axes[0][0]
    figure.subplots_adjust(left=0.02, right=0.98, bottom=0.02, top=0.92)
    images = []
    for t in np.linspace(0.0, end, count):
        k = min(int(np.searchsorted(run.t, t)), len(run.t) - 1)
        ax.clear()
        _frame(ax, biped, run, k)
        figure.canvas.draw()
        pixels: Any = figure.canvas
        image = Image.fromarray(np.asarray(pixels.buffer_rgba())[..., :3].copy())
        images.append(image.quantize(colors=64, method=Image.Quantize.FASTOCTREE))
    out = io.BytesIO()
    pause = max(20, round(1000 * end / count / 10) * 10)
    images[0].save(out, format="GIF", save_all=True, append_images=images[1:], duration=pause, loop=0, optimize=False)
    return out.getvalue()


def _frame(ax: Axes, biped: Biped, run: Trajectory, k: int) -> None:
    L, toe, heel = biped.L, biped.toe, biped.heel
    alpha = float(run.alpha[k]) if run.alpha is not None else 0.0
    along = np.array([math.cos(alpha), -math.sin(alpha)])  # the ground, downhill on the toe side
    up = np.array([math.sin(alpha), math.cos(alpha)])
    theta = float(run.theta[k])
    body = math.sin(theta) * along + math.cos(theta) * up
    lost = run.F_T[k] < 0 or run.F_H[k] < 0
    scale = 0.55 * L / biped.weight  # metres a newton

    under = -biped.height * up  # the point of the ground under the ankle
    ground = np.array([-1.4 * L * along, 1.4 * L * along]) + under
    ax.fill_between(ground[:, 0], ground[:, 1], -2 * L, color="#ece8df")
    ax.plot(ground[:, 0], ground[:, 1], color=GREY, linewidth=1)
    foot = np.array([-heel * along, toe * along]) + under
    if biped.height:
        outline = np.array([foot[0], [0.0, 0.0], foot[1]])
        ax.fill(outline[:, 0], outline[:, 1], color=RED if lost else "black", alpha=0.35, linewidth=0)
    ax.plot(foot[:, 0], foot[:, 1], color=RED if lost else "black", linewidth=6, solid_capstyle="round")
    tip = 1.6 * L * body
    ax.plot([0, tip[0]], [0, tip[1]], color="#333333", linewidth=5, solid_capstyle="round")
    ax.plot(*(L * body), "o", color="white", markeredgecolor="#333333", markersize=11)
    for place, force, colour in ((toe, run.F_T[k], BLUE), (-heel, run.F_H[k], ORANGE)):
        _arrow(ax, place * along + under, scale * force * up, colour)
    push = run.F[0, k] * along + run.F[1, k] * up
    if np.hypot(*push) > 1e-9:
        _arrow(ax, L * body, scale * push * 2, RED)
    if -heel <= run.P[k] <= toe:
        ax.plot(*(run.P[k] * along + under), "^", color=RED, markersize=8, zorder=5)
    ax.set_aspect("equal")
    ax.set_xlim(-1.1 * L, 1.1 * L)
    ax.set_ylim(-0.55 * L, 1.75 * L)
    ax.set_axis_off()
    slope = f", slope {math.degrees(alpha):.1f}°" if run.alpha is not None else ""
    heading(ax, f"{run.scenario}, t = {run.t[k]:.2f} s{slope}")
    said = f"toe {run.F_T[k]:.0f} N (blue), heel {run.F_H[k]:.0f} N (orange), CoP {1e3 * run.P[k]:+.0f} mm (▲)"
    ax.text(0, -0.47 * L, said, ha="center", fontsize=8, color=RED if lost else "black")
    frame = ", in the ground's frame" if slope else ""
    force = f"external force ({run.F[0, k]:+.0f}, {run.F[1, k]:+.0f}) N (red, x 2{frame})"
    ax.text(0, -0.54 * L, force, ha="center", fontsize=8)


def _arrow(ax: Axes, foot: np.ndarray, way: np.ndarray, colour: str) -> None:
    if np.hypot(*way) < 1e-6:
        return
    end = foot + way
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 2.2, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", xy=(end[0], end[1]), xytext=(foot[0], foot[1]), arrowprops=style)
