"""Exported C assumes no widths of its types, and needs nothing that a controller lacks."""

import re
import shutil
import subprocess

import numpy as np
import portability
import pytest
from export_cases import BEARING, CASES, INCLUDES, SAME_BITS, STRICT, flight_files, program
from exporting import export_c
from machine_cases import machine
from quick import quick

import ambkit
from ambkit.base.errors import AmbkitError

FEW = [("adaptive", "double"), ("unscented", "float")]
needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


@needs_cc
@pytest.mark.parametrize(("kind", "precision"), quick(CASES, FEW))
def test_nothing_is_assumed_of_the_machine(exported, kind, precision):
    made = exported(kind, precision)
    found = portability.lint(made.folder, flight_files(made), INCLUDES, real=precision)
    assert sorted(found) == []


FAULTS = {
    "header": '#include "a.h"\n#include <math.h>',
    "call": "void *malloc(unsigned int n);\nvoid *f(void) { return malloc(2U); }",
    "recursion": "int g(int n);\nint f(int n) { return g(n); }\nint g(int n) { return f(n); }",
    "recursion by a pointer": "typedef struct s { int (*go)(int); } s;\n"
    "int f(int n);\nstatic const s to = {f};\nint f(int n) { return to.go(n); }",
    "recursion by a pointer in a struct of structs": "typedef struct s { int (*go)(int); } s;\n"
    "int f(int n);\nstatic const s to[1] = {{f}};\nint f(int n) { return to[0].go(n); }",
    "recursion by an argument": "static int g(int (*go)(int)) { return go(1); }\n"
    "int f(int n) { return g(f) + n; }",
    "variable": "int last;",
    "variable, static": "int f(void) { static int calls = 0; calls++; return calls; }",
    "variable, a pointer that can change": "static const int n = 1;\nconst int *at = &n;",
    "variable, an array": "extern int seen[4];",
    "variable-length": "int f(int n) { int a[n]; a[0] = n; return a[0]; }",
    "variable-length, an argument": "int f(int n, int a[n]) { return a[0]; }",
    "array": "const int many[200 * 200] = {0};",
    "char": "int f(const char *text) { return (int)text[0]; }",
    "char, of 8 bits": "#include <stdint.h>\nuint8_t low(unsigned int n) { return (uint8_t)n; }",
    "char, a character": "int f(void) { return 'a'; }",
    "char, a field": "typedef struct s { signed char low; } s;",
    "double": "float f(float a) { return a * 0.5; }",
    "double, a type": "float f(float a) { return (float)((double)a * a); }",
    "literal": "int f(void) { return 32768; }",
    "literal, hexadecimal": "unsigned int f(void) { return 0x8000; }",
    "literal, unsigned": "unsigned int f(void) { return 65536U; }",
    "literal, long": "unsigned long f(void) { return 4294967296UL; }",
    "shift": "unsigned long f(unsigned int n) { return n << 16; }",
    "shift, signed": "int f(int n) { return n << 1; }",
    "shift, by what": "unsigned int f(unsigned int n) { return 1U << n; }",
    "shift, a field": "typedef struct s { unsigned int low; } s;\n"
    "unsigned long f(s a) { return a.low >> 20; }",
    "shift, in place": "unsigned int f(unsigned int n) { n <<= 24; return n; }",
    "shift, too far at last": "#include <stdint.h>\n"
    "typedef union u { uint32_t bits; } u;\n"
    "uint32_t f(u a) { return (UINT32_C(127) - a.bits) << 32; }",
}
GOOD = {
    "whole numbers": "unsigned long f(void) { return 32767 + 65535U + 65536UL + 0xFFFFU; }",
    "shifts": "#include <stdint.h>\ntypedef union u { uint32_t bits; } u;\n"
    "uint32_t f(u a) { return ((UINT32_C(127) - a.bits) << 31) + (1U << 15); }",
    "constants": "static const int n[2] = {1, 2};\nstatic const int *const at = n;\n"
    "const int *f(void) { return at; }",
    "pointers to functions": "typedef struct s { int (*go)(int); } s;\n"
    "static int g(int n) { return n; }\nstatic const s to = {g};\n"
    "int f(int n) { return to.go(n); }",
    "pointers to different functions": "typedef struct s { int (*go)(int); int (*on)(int); } s;\n"
    "static int g(int n) { return n; }\nint f(int n);\nstatic const s to = {g, f};\n"
    "int f(int n) { return to.go(n); }",
    "pointers in tables with names": "typedef struct s { int (*go)(int); } s;\n"
    "static int g(int n) { return n; }\nint f(int n);\nstatic const s to = {.go = g}, back = {f};\n"
    "int f(int n) { return to.go(n) + (int)(back.go == 0); }",
    "arrays": "int f(int a[4]) { const int b[2 + 2] = {0, 0, 0, 0}; return a[3] + b[3]; }",
}


def lint(folder, text):
    (folder / "a.h").write_text("")
    (folder / "a.c").write_text(text + "\n")
    return portability.lint(folder, ["a.h", "a.c"], ["-I."], real="float")


@needs_cc
@pytest.mark.parametrize("fault", FAULTS)
def test_the_rule_bites(tmp_path, fault):
    found = lint(tmp_path, FAULTS[fault])
    assert {each.rule for each in found} == {fault.split(",")[0].split()[0]}
    assert {each.file for each in found} == {"a.c"}


def test_every_rule_is_tried():
    rules = {
        line.split()[0]
        for line in (portability.__doc__ or "").split("====\n")[1].splitlines()
        if line[:1].isalpha()
    }
    assert {fault.split(",")[0].split()[0] for fault in FAULTS} == rules


@needs_cc
@pytest.mark.parametrize("good", GOOD)
def test_the_rules_bite_nothing_else(tmp_path, good):
    assert lint(tmp_path, GOOD[good]) == set()


# ---- A compiler for a machine whose int has 16 bits ----

MSP430 = ["clang", "--target=msp430", "-std=c99", "-ffreestanding", "-fsyntax-only", *STRICT]


def compiled_for_16_bits(folder, *files):
    command = [*MSP430, *INCLUDES, *files]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def msp430(tmp_path_factory):
    if shutil.which("clang") is None:
        pytest.skip("clang is not installed")
    folder = tmp_path_factory.mktemp("msp430")
    (folder / "a.c").write_text("typedef int of_16_bits[(sizeof(int) == 2) ? 1 : -1];\n")
    if compiled_for_16_bits(folder, "a.c").returncode:
        pytest.skip("this clang does not know the MSP430")


@pytest.mark.parametrize(("kind", "precision"), quick(CASES, FEW))
def test_a_compiler_with_an_int_of_16_bits_finds_nothing(msp430, exported, kind, precision):
    made = exported(kind, precision)
    done = compiled_for_16_bits(made.folder, *made.sources)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("fault", ["literal", "literal, unsigned", "shift", "shift, in place"])
def test_that_compiler_would_find_what_others_do_not(msp430, tmp_path, fault):
    (tmp_path / "a.c").write_text(FAULTS[fault] + "\n")
    done = compiled_for_16_bits(tmp_path, "a.c")
    assert "a.c:1:" in done.stderr
    assert re.search(r"-W(constant-conversion|shift-count-overflow)", done.stderr)
    usual = [word for word in MSP430 if "msp430" not in word]
    here = subprocess.run([*usual, "a.c"], cwd=tmp_path, capture_output=True, text=True)
    assert (here.returncode, here.stderr) == (0, "")


# ---- The other byte order ----

BIG_ENDIAN = ("s390x-linux-gnu-gcc", "qemu-s390x")


@pytest.mark.long
@pytest.mark.skipif(
    not all(map(shutil.which, BIG_ENDIAN)), reason=f"not there: one of {', '.join(BIG_ENDIAN)}"
)
@pytest.mark.parametrize("of", ["linear", "double", "tabulated", "controller", "machine"])
def test_the_other_byte_order_gives_the_same_bits(exported, of, tmp_path):
    if of == "controller":
        made = export_c(BEARING, None, tmp_path / "c", prefix="f", scenario=ambkit.Scenario())
    elif of == "machine":
        made = export_c(machine(), None, tmp_path / "c", prefix="f", scenario=ambkit.Scenario())
    else:
        made = exported("adaptive", "double") if of == "double" else exported(of)
    compiler, emulator = BIG_ENDIAN
    # In ISO mode gcc has float computed as double on this machine alone.
    words = ["-static", "-fexcess-precision=fast", *SAME_BITS]
    done = program(compiler, made.folder, tmp_path / "test.out", tuple(words))
    assert done.returncode == 0, done.stderr
    run = [emulator, str(tmp_path / "test.out")]
    said = subprocess.run(run, capture_output=True, text=True, timeout=120).stdout
    assert said.startswith("pass")
    assert "equal to the last bit" in said


def test_a_table_that_an_int_of_16_bits_cannot_count_is_refused(tmp_path):
    fine = ambkit.stiffness_map(
        BEARING, currents=np.linspace(-1, 1, 182), displacements=np.linspace(-5e-4, 5e-4, 181)
    )
    with pytest.raises(AmbkitError, match=r"181 x 182 nodes, .* at most 32767"):
        export_c(BEARING, fine, tmp_path / "out")
    assert not (tmp_path / "out").exists()
