"""Draw the picture of the README and of the first page: python docs/make_images.py.

It is committed, so that the README shows it without a build.
"""

from io import BytesIO
from pathlib import Path

from PIL import Image

from ambkit.show.report import static
from ambkit.show.report.figure import Figure, Panel
from ambkit.show.report.items import Axis, Line
from ambkit.workflow.reproduction.gain import LOAD, STEPS
from ambkit.workflow.reproduction.study import POSITION, TIME, Study

FOLDER = Path(__file__).parent / "images"
FORCE = Axis(r"disturbance force $F_\mathrm{St}$", "N", limits=(-1.2, 4.2))
LINEAR, ADAPTIVE = "estimate linear", "estimate wide box"


def step() -> Figure:
    """Show the step of 0.5 mm and the load of 3 N with the linear and the adaptive filter."""
    study = Study()
    scenario = study.scenario(STEPS[-1], LOAD)
    runs = {name: study.run(scenario, name) for name in (LINEAR, ADAPTIVE)}
    shown = {name: run.estimate for name, run in runs.items() if run.estimate is not None}
    record = runs[ADAPTIVE].record
    t = record.t
    return Figure(
        id="step",
        title="A step of 0.5 mm and a load of 3 N",
        caption="",
        panels=[
            Panel(TIME, POSITION, [
                Line(t, record["y"], signal="measured"),
                Line(t, record["r"], signal="reference"),
                Line(t, record["x"], signal="truth"),
                Line(t, shown[ADAPTIVE].x, signal="estimate adaptive"),
            ]),
            Panel(TIME, FORCE, [
                Line(t, shown[LINEAR].f_d, signal=LINEAR),
                Line(t, shown[ADAPTIVE].f_d, signal="estimate adaptive"),
                Line(t, record["f_d"], signal="truth"),
            ]),
        ],
    )  # fmt: skip


def small(png: bytes, colours: int = 48) -> bytes:
    """Write a picture with a palette of colours, in a third of the bytes."""
    out = BytesIO()
    Image.open(BytesIO(png)).convert("RGB").quantize(colours).save(out, "PNG", optimize=True)
    return out.getvalue()


if __name__ == "__main__":
    (FOLDER / "step.png").write_bytes(small(static.render(step()).png))
