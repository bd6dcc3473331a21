"""A campaign of single bit flips over what an export keeps in RAM; ``tests/export/bit_flips.c``."""

import re
import subprocess
from pathlib import Path
from typing import NamedTuple

from export_cases import INCLUDES, SAME_BITS

from ambkit.export.c import CExport

DRIVER = Path(__file__).parent / "export" / "bit_flips.c"

FILTER = """
typedef struct { amb_real integral, x, v; } outside;
static outcome step(rig_state *s, outside *o, const amb_real y[], amb_real iu[])
{
  rig_estimates now;
  const amb_kalman_settings *set = &KF.set;
  const amb_status status = rig_step(s, y[0], iu[0] / set->k_ui[0], &now);
  const outcome h = {now.feed_back, true, status};
  const amb_real shown = y[0] / set->K_sen[0];
  o->v += ((shown - o->x) - set->T * o->v) / ((amb_real)T_F + set->T);
  o->x = shown;
  const amb_real x = now.feed_back ? now.x : shown, v = now.feed_back ? now.v : o->v;
  o->integral =
      amb_clamp(o->integral - set->T * (amb_real)KI * x, set->iu_min[0], set->iu_max[0]);
  iu[0] = amb_clamp(o->integral - (amb_real)KP * x - (amb_real)KD * v, set->iu_min[0],
                    set->iu_max[0]);
  return h;
}
static void begin(rig_state *s) { BEGIN; }
"""
"""A filter of one axis, fed back to a controller whose memory is not touched."""

AXIS = """
typedef struct { int k; } outside;
static void transfer(rig_state *s) { rig_transfer(s, 0, 0); }
static outcome sample(rig_state *s, const amb_real y[], amb_real iu[])
{
  rig_output now;
  const amb_status status = rig_step(s, y[0], 0, true, &now);
  const outcome h = {now.usable, now.mode == AMB_FLYING, status};
  iu[0] = now.iu;
  return h;
}
"""
"""The whole controller of one axis."""

CONTROLLER = """
static void begin(NAME_STATE *s) { transfer(s); }
static outcome step(NAME_STATE *s, outside *o, const amb_real y[], amb_real iu[])
{
  (void)o;
  return sample(s, y, iu);
}
"""

CALIBRATED = """
static void begin(memory *s)
{
  transfer(&s->rig);
  rig_cal_init(&s->cal);
  for (int n = 0; n < AMB_PARAMETERS; n++) {
    if (rig_base.kind[n] == AMB_VAR_Y)
      s->cal.wanted[n] *= (amb_real)1.1;
    if (rig_base.kind[n] == AMB_MASS)
      s->cal.wanted[n] *= (amb_real)1.01;
  }
  s->cal.request++;
  rig_calibrate(&s->cal, &s->rig);
}
static outcome step(memory *s, outside *o, const amb_real y[], amb_real iu[])
{
  if (o->k++ % 10 == 9)
    rig_calibrate(&s->cal, &s->rig);
  return sample(&s->rig, y, iu);
}
"""

SEVERAL = """
typedef struct { int k; } outside;
static const amb_real middle[AMB_CONTROLS], nowhere[AMB_SENSORS];
static void transfer(rig_control_state *s)
{
  rig_control_transfer(s, nowhere, SPEED, middle);
}
static outcome sample(rig_control_state *s, const amb_real y[], amb_real iu[])
{
  rig_command now;
  const amb_status status = rig_control_step(s, y, middle, SPEED, true, &now);
  const outcome h = {now.estimates.feed_back, now.mode == AMB_FLYING, status};
  for (int c = 0; c < AMB_CONTROLS; c++)
    iu[c] = now.iu[c];
  return h;
}
"""
"""The whole controller of several axes."""


class Found(NamedTuple):
    """What became of the flights."""

    flips: int
    stuck: int
    wrong: int
    crashed: int
    flagged: int
    touched: int
    longest: int
    """Samples for which an estimate was fed back wrong, at most."""
    lines: tuple[str, ...]
    """Of those that did harm; the first one tells of the healthy flight."""


def source(text: str, **macros: object) -> str:
    """Return a campaign's program: what is stepped, and how."""
    headers = str(macros.pop("header", "rig.h")).split()
    includes = [f'#include "{name}"' for name in (*headers, "rig_data.h", "src/kalman_step.h")]
    rig = macros.pop("rig", "rig_state")
    macros = {"NOISE": 1.0, "LOAD": 0.0, "NAME_STATE": "rig_state", "PLACE": "filter"} | macros
    lines = [f"#define {name} {value}" for name, value in macros.items()]
    memory = f"typedef struct {{ {rig} rig; amb_calibration cal; }} memory;\n"
    lines += ["#define FILTER(s) ((const amb_kalman_state *)(const void *)&(s)->PLACE)"]
    lines += ["typedef struct outcome { bool fed; bool up; amb_status status; } outcome;"]
    lines += [memory] if macros["NAME_STATE"] == "memory" else []
    return "\n".join([*includes, *lines, text, f'#include "{DRIVER}"', ""])


def magnets_of(made: CExport) -> dict[str, str]:
    """Return what the rotor's forces are, as a macro."""
    data = (made.folder / "rig_data.h").read_text()
    if "rig_stiffness" in data:
        return {"STIFFNESS": "rig_stiffness"}
    return {"MAGNETS": "rig_magnet" if "rig_magnet[" in data else "(&rig_magnet)"}


def compiled(made: CExport, program: str, *flags: str, optimise: bool = True) -> Path:
    """Return the program, compiled with the export; few flights take less than optimising does."""
    main, out = made.folder / "bit_flips.c", made.folder / "bit_flips"
    main.write_text(program)
    command = ["gcc", "-std=gnu99", *SAME_BITS[1:], "-O2" if optimise else "-O0", *flags, *INCLUDES]
    done = subprocess.run(
        [*command, *made.sources, main, "-o", out], cwd=made.folder, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    return out


def campaign(
    made: CExport, program: str, settling: int, *, before: int = 2000, after: int = 3000,
    every: int = 1, first: int = 0, many: int = 1,
) -> Found:  # fmt: skip
    """Fly with each bit flipped, or with one of so `every` from the `first` on.

    With more than it, up to so `many` at once, drawn at random.
    """
    out = compiled(made, program, optimise=many > 1 or every < 32)
    words = [str(n) for n in (before, after, settling, every, first, many)]
    text = subprocess.run([out, *words], capture_output=True, text=True, check=True).stdout
    lines = text.splitlines()
    numbers = [int(n) for n in re.findall(r"\d+", lines[-1])]
    total, stuck, wrong, crashed, flagged, touched, longest = numbers
    return Found(total, stuck, wrong, crashed, flagged, touched, longest, tuple(lines[:-1]))


def settling_in(made: CExport) -> int:
    """Return the samples until an estimate is settled, as the header has it."""
    header = (made.folder / f"{made.name}.h").read_text()
    return int(re.findall(r"_SETTLING (\d+)U", header)[0])
