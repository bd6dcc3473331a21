"""The bound on the instructions of a call: what is counted, and what has none."""

import shutil
import subprocess

import pytest

from ambkit.export.pil.build import ARM, QEMU_BOARD
from firmware import path
from firmware.registers import LR, SP, State

pytestmark = pytest.mark.skipif(
    shutil.which(f"{ARM}gcc") is None, reason="gcc-arm-none-eabi is not installed"
)

HEAD = ".syntax unified\n.thumb\n.text\n.globl f\n.type f, %function\n.thumb_func\nf:\n"
# Instructions, and how many are executed at most.
COUNTED = {
    "straight on": ("mov r3, #1\nadd r3, r3, r0\nbx lr", 3),
    "ten rounds": ("movs r3, #10\n1: subs r3, r3, #1\nbne 1b\nbx lr", 22),
    "the longer way": ("cmp r0, #0\nbeq 1f\nnop\nnop\n1: bx lr", 5),
    "a way that is known": ("movs r3, #0\ncmp r3, #0\nbeq 1f\nnop\nnop\n1: bx lr", 4),
    "either way in each of 40 rounds": (
        "movs r3, #40\n1: cmp r0, #7\nbeq 2f\nadds r0, r0, #1\nnop\nsubs r3, r3, #1\nbne 1b\n"
        "bx lr\n2: subs r3, r3, #1\nbne 1b\nbx lr",
        2 + 6 * 40,
    ),
    "a loop in a loop": (
        "movs r3, #5\n1: movs r2, #4\n2: subs r2, r2, #1\nbne 2b\nsubs r3, r3, #1\nbne 1b\nbx lr",
        1 + 5 * (1 + 2 * 4 + 2) + 1,
    ),
    "under a condition, done or not": ("cmp r0, #0\nite eq\nmoveq r0, #1\nmovne r0, #2\nbx lr", 5),
    "calls": (
        "push {r4, lr}\nmovs r4, #3\n1: bl g\nsubs r4, r4, #1\nbne 1b\npop {r4, pc}\n"
        ".type g, %function\n.thumb_func\ng: nop\nbx lr",
        2 + 3 * (3 + 2) + 1,
    ),
    "by a table": (
        "tbb [pc, r1]\n1: .byte (2f-1b)/2, (3f-1b)/2\n2: nop\nbx lr\n3: nop\nnop\nnop\nbx lr",
        5,
    ),
    "a counter in memory": (
        "sub sp, #8\nmovs r3, #6\nstr r3, [sp, #4]\n1: ldr r3, [sp, #4]\nsubs r3, r3, #1\n"
        "str r3, [sp, #4]\nbne 1b\nadd sp, #8\nbx lr",
        3 + 6 * 4 + 2,
    ),
}
NONE = {
    "rounds by an argument": ("1: subs r1, r1, #1\nbne 1b\nbx lr", "ends where data say"),
    "a pointer from data": ("ldr r3, [r0]\nbx r3", "goes where data say"),
    "a place from data": ("str r1, [r2]\nbx lr", "an address that depends on data"),
}


def linked(folder, source, *flags):
    image = folder / "f.elf"
    link = ("-nostdlib", "-Wl,-Ttext=0", "-Wl,-ef", f"-T{folder / 'f.ld'}")
    (folder / "f.ld").write_text("SECTIONS { .text 0 : { *(.text*) *(.rodata*) } }")
    words = [f"{ARM}gcc", *QEMU_BOARD.target[:-1], *flags, *link, str(source), "-o", str(image)]
    subprocess.run(words, check=True, capture_output=True)
    return image


def found(folder, text):
    source = folder / "f.s"
    source.write_text(HEAD + text + "\n")
    return path.bound(linked(folder, source), "f", objects=0b1)


@pytest.mark.parametrize("of", COUNTED)
def test_the_longest_way_is_counted(of, tmp_path):
    text, most = COUNTED[of]
    assert found(tmp_path, text) == (most, "")


@pytest.mark.parametrize("of", NONE)
def test_what_depends_on_data_has_no_bound(of, tmp_path):
    text, why = NONE[of]
    told = found(tmp_path, text)
    assert told.instructions is None
    assert why in told.why


NUMBERS = """
static const int table[] = {3, -7, 1000003, 12, -5, 77, 0, 31};
static const unsigned char low[] = {200, 3, 255, 16};
static const short half[] = {-300, 12000};
int f(void)
{
  unsigned int sum = 0x12345678U;
  int kept[8];
  for (int i = 0; i < 8; i++) {
    const int a = table[i];
    kept[7 - i] = (a > 5) ? (a * 13) - (int)(sum >> 5) : (a / 3) ^ (int)(sum & 0xFF0FU);
    sum = (sum << 3) | (sum >> 29);
    sum += (unsigned int)(a >> 2) - low[i & 3];
    sum ^= (unsigned int)(half[i & 1] + (signed char)low[(i + 1) & 3]);
    sum = (i % 3 == 1) ? ~sum : sum - (unsigned int)i * 7U;
  }
  for (int i = 1; i < 8; i++)
    sum = sum * 31U + (unsigned int)kept[i] / (low[i & 3] + 1U);
  return (int)sum;
}
"""


@pytest.mark.parametrize("optimised", ["-O0", "-O1", "-O2", "-O3", "-Os"])
def test_whole_numbers_are_those_that_a_processor_computes(optimised, tmp_path):
    source = tmp_path / "f.c"
    source.write_text(NUMBERS)
    main = '#include <stdio.h>\nint f(void);\nint main(void) { printf("%d", f()); return 0; }\n'
    (tmp_path / "main.c").write_text(main)
    here = tmp_path / "here"
    words = ["gcc", str(source), str(tmp_path / "main.c"), "-fsigned-char", "-o", str(here)]
    subprocess.run(words, check=True)
    told = int(subprocess.run([here], capture_output=True, text=True, check=True).stdout)
    program = path.load(linked(tmp_path, source, optimised, "-fsigned-char"))
    state = State(program.constants)
    state.r[SP], state.r[LR] = 0x20400000, 0xFFFFFFFE
    (entry,) = [at for at, name in program.names.items() if name == "f"]
    path.Walk(program).call(state, entry)
    assert state.r[0] == told & 0xFFFFFFFF
