# What ./run and ./test share; sourced by both. Sets up .venv with everything in uv.lock, quietly, and
# leaves the command `uv` in $UV. A second call takes a fraction of a second.
# shellcheck shell=bash

stop() {
  printf 'ambkit: %s\n' "$*" >&2
  exit 2
}

# A shim of pyenv may be there and complain that it stands for nothing.
for candidate in python3.13 python3.12 python3.11 python3; do
  command -v "$candidate" >/dev/null || continue
  # The interpreter itself: given a shim, uv takes .venv for another Python's, and makes it anew each time.
  PYTHON=$("$candidate" -c 'import sys; sys.version_info < (3, 11) and sys.exit(1); print(sys.executable)' 2>/dev/null) && break
  PYTHON=
done
[ -n "${PYTHON:-}" ] || stop "Python 3.11 or newer is needed (Debian: apt-get install python3)"

command -v c++ >/dev/null || command -v g++ >/dev/null || command -v clang++ >/dev/null ||
  stop "a C and C++ compiler is needed (Debian: apt-get install g++)"
"$PYTHON" -c 'import os, sysconfig, sys; sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' ||
  stop "the headers of $PYTHON are needed (Debian: apt-get install python3-dev)"

# uv installs what uv.lock names. It comes from the machine, or into .tools without touching it.
if command -v uv >/dev/null; then
  UV=uv
else
  UV=.tools/bin/uv
  if [ ! -x "$UV" ]; then
    "$PYTHON" -m pip --version >/dev/null 2>&1 ||
      stop "pip is needed to fetch uv (Debian: apt-get install python3-pip)"
    echo "Fetching uv into .tools ..." >&2
    "$PYTHON" -m pip install --quiet --disable-pip-version-check --root-user-action=ignore \
      --target .tools uv || stop "uv could not be fetched; is there a network?"
  fi
fi

[ -d .venv ] || echo "Setting up .venv and building the C core, about a minute ..." >&2
# The install knows the modules that there were: one that came or moved since would not be found.
modules=$(find src/ambkit -name '*.py' | LC_ALL=C sort | cksum)
again=
[ "$modules" = "$(cat .venv/modules 2>/dev/null)" ] || again=--reinstall-package=ambkit
# --inexact keeps what other commands (docs, benchmarks) installed beside it.
"$UV" sync --locked --inexact --quiet --no-progress --python "$PYTHON" --no-python-downloads $again ||
  stop "the set-up did not succeed, see above"
echo "$modules" >.venv/modules
export PATH="$PWD/.venv/bin:$PATH"
# Containers often set it. Without compiled modules each process compiles all that it imports: 3 s in place of 1.
unset PYTHONDONTWRITEBYTECODE
