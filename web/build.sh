#!/usr/bin/env bash
# Build the workbench: the C to WebAssembly, the TypeScript to one script, both into one page, which is
# committed. web/build.sh --check builds it elsewhere and compares: with the same versions of the tools byte
# by byte, with others only that it is of the same sources.
set -euo pipefail
cd "$(dirname "$0")"

CLANG=${CLANG:-$(command -v clang-14 || command -v clang)}
page=../src/ambkit/export/browser/page.html
mkdir -p build
[ -d node_modules/esbuild ] || npm ci --silent --no-audit --no-fund || {
  [ "${1:-}" = --check ] || exit 1
  echo "web/build.sh: npm's registry was not reached; the page was not built anew" >&2
  exit 0
}

flags=(--target=wasm32-wasi -std=c99 -O2 -ffp-contract=off -fno-math-errno -ffunction-sections -fdata-sections
  -fno-ident -DNDEBUG -DAMB_DOUBLE -DAMB_NO_VECTORS -I../core/include -I../core -I../sim)
link=(-mexec-model=reactor -Wl,--gc-sections -Wl,--strip-all -Wl,-z,stack-size=524288)

"$CLANG" "${flags[@]}" -DAMB_MODEL_LOOPS "${link[@]}" core/*.c ../core/src/*.c ../sim/*.c -o build/core.wasm
node_modules/.bin/tsc --noEmit -p .
node bundle.mjs "$("$CLANG" --version | head -1)" >build/page.html
if [ "${1:-}" = --check ]; then
  node bundle.mjs --compare build/page.html "$page"
else
  mkdir -p "$(dirname "$page")"
  cp build/page.html "$page"
  wc -c "$page"
fi
