"""Draw the pictures of README.md and of the pages: python docs/make_images.py.

They are committed, so that they show without a build.
"""

from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

from paper.gain import LOAD, STEPS
from paper.study import POSITION, TIME, Study
from PIL import Image

import ambkit
from ambkit.result.report import Axis, Figure, Line, Panel

FOLDER = Path(__file__).parent / "images"
FORCE = Axis(r"disturbance force $f_d$", "N", limits=(-1.2, 4.2))
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


def margins() -> Figure:
    """Show the bearing of docs/how-to/assess.md, on the measurement and with two filters."""
    laboratory = ambkit.preset("zittau_axial").replace(
        name="laboratory",
        magnet__magnet_constant="3.6413 N mm^2/A^2",
        magnet__air_gap="0.78 mm",
        magnet__bias_current="2.5 A",
        rotor__mass="3.27 kg",
        rotor__gravity="none",
        rotor__clearance="0.3 mm",
        amplifier__current_limit="2.4 A",
        amplifier__bandwidth="2 kHz",
        sensor__lag="16 µs",
        sensor__noise_variance="0.25 µm^2",
        delay="0.15 ms",
    )
    plain = laboratory.replace(delay=None, amplifier__bandwidth=None)
    result = ambkit.assess(
        laboratory,
        {
            "without amplifier and dead time": ambkit.KalmanFilter(plain),
            "told of both": ambkit.KalmanFilter(laboratory),
        },
    )
    return result.figure()


def field() -> Figure:
    """Show the field of the bearing of docs/how-to/drawing.md."""
    page = (FOLDER.parent / "how-to" / "drawing.md").read_text(encoding="utf-8")
    text = page.split(":::{file} radial.toml\n")[1].split(":::")[0]
    with TemporaryDirectory() as folder:
        (Path(folder) / "radial.toml").write_text(text, encoding="utf-8")
        return ambkit.magnet(Path(folder) / "radial.toml").figure()


def small(png: bytes, colours: int = 48) -> bytes:
    """Write a picture with a palette of colours, in a third of the bytes."""
    out = BytesIO()
    Image.open(BytesIO(png)).convert("RGB").quantize(colours).save(out, "PNG", optimize=True)
    return out.getvalue()


if __name__ == "__main__":
    (FOLDER / "step.png").write_bytes(small(step().image(".png")))
    (FOLDER / "assess.png").write_bytes(small(margins().image(".png")))
    (FOLDER / "magnet_field.png").write_bytes(small(field().image(".png")))
