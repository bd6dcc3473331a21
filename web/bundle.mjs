// One page from script, style, WebAssembly and template; or the comparison of two pages.
import { createHash } from "node:crypto";
import { readFileSync, readdirSync, statSync } from "node:fs";
import { join } from "node:path";
import * as esbuild from "esbuild";

const OWN = ["core", "src", "vendor"]; // folders of the sources that are the page's own
const FILES = ["package.json", "package-lock.json", "tsconfig.json", "bundle.mjs", "build.sh"];

function files(folder, ends) {
  return readdirSync(folder)
    .sort()
    .flatMap((name) => {
      const path = join(folder, name);
      if (statSync(path).isDirectory()) return files(path, ends);
      return !ends || ends.some((end) => name.endsWith(end)) ? [path] : [];
    });
}

function hash(paths) {
  const sum = createHash("sha256");
  for (const path of paths) sum.update(path + "\0").update(readFileSync(path)).update("\0");
  return sum.digest("hex");
}

function meta(page, name) {
  return page.match(new RegExp(`<meta name="${name}" content="([^"]*)"`))?.[1];
}

function compare(built, committed) {
  const [now, then] = [built, committed].map((path) => readFileSync(path, "utf8"));
  for (const name of ["workbench-sources", "workbench-c"])
    if (meta(now, name) !== meta(then, name))
      throw `${committed} is not of these sources (${name}): build it anew by web/build.sh`;
  if (meta(now, "workbench-tools") !== meta(then, "workbench-tools"))
    return console.log(`built by other tools (${meta(then, "workbench-tools")}): not compared byte by byte`);
  if (now !== then) throw `${committed} is not what its sources give: build it anew by web/build.sh`;
}

async function bundle(clang) {
  const of = { entryPoints: ["src/main.ts"], bundle: true, minify: true, write: false, target: "es2021", charset: "utf8" };
  const script = await esbuild.build({ ...of, format: "iife", legalComments: "inline" });
  const style = await esbuild.build({ ...of, entryPoints: ["src/style.css"] });
  const tools = `${clang.replace(/^.*?clang version /, "clang ").split(/[ -]/).slice(0, 2).join(" ")}, esbuild ${esbuild.version}`;
  const fill = {
    SOURCES: hash([...OWN.flatMap((folder) => files(folder)), ...FILES].sort()),
    C: hash([...files("../core", [".c", ".h"]), ...files("../sim", [".c", ".h"])]),
    TOOLS: tools,
    STYLE: style.outputFiles[0].text,
    WASM: readFileSync("build/core.wasm").toString("base64"),
    SCRIPT: script.outputFiles[0].text.replaceAll("</script", "<\\/script"),
  };
  const page = readFileSync("src/page.html", "utf8");
  return page.replace(/\{\{(\w+)\}\}/g, (_, name) => fill[name]);
}

try {
  if (process.argv[2] === "--compare") compare(process.argv[3], process.argv[4]);
  else process.stdout.write(await bundle(process.argv[2]));
} catch (error) {
  console.error(`workbench: ${error.message ?? error}`);
  process.exit(1);
}
