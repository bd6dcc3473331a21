// The C of a page in Node: node workbench_node.js PAGE, the question on stdin.
const fs = require("node:fs");
const page = fs.readFileSync(process.argv[2], "utf8"), asked = JSON.parse(fs.readFileSync(0));
const wasm = Buffer.from(page.match(/id="wasm">([^<]*)</)[1], "base64");
const wasi_snapshot_preview1 = new Proxy({}, { get: () => () => 0 });
WebAssembly.instantiate(wasm, { wasi_snapshot_preview1 }).then(({ instance }) => {
  const c = instance.exports, reals = (at, n) => new Float64Array(c.memory.buffer, at, n), n = asked.r.length;
  c._initialize?.();
  const text = new Uint8Array(c.memory.buffer, c.names());
  const names = new TextDecoder().decode(text.slice(0, text.indexOf(0))).trim().split(" ");
  const p = { ...asked.p, samples: n, reference: asked.r[0], load: asked.f_d[0] };
  names.forEach((name, k) => (reals(c.parameters(), names.length)[k] = p[name] ?? 0));
  const { models } = JSON.parse(page.match(/id="data">([^<]*)</)[1]), samples = p.delay / p.T, past = Math.ceil(samples - 1e-9);
  const model = models[2 * past + (p.bandwidth > 0 ? 1 : 0)];
  reals(c.model_input(), model.length).set(model);
  c.read_model();
  c.set_share(Math.min(samples - (past - 1), 1));
  reals(c.series(0), n).set(asked.r);
  reals(c.series(1), n).set(asked.f_d);
  const states = c.fly(asked.kinds[0]);
  asked.kinds.slice(1).forEach((kind, j) => c.estimate(j + 1, kind));
  const series = (k) => [...reals(c.series(k), n)];
  const history = (j, k, width) => [...reals(c.history(j, k), width * n)];
  const filters = asked.kinds.map((_, j) => {
    return { mean: history(j, 0, states), innovation: history(j, 2, 1), variance: history(j, 3, 1) };
  });
  fs.writeFileSync(1, JSON.stringify({ x: series(4), v: series(5), y: series(9), u: series(10), iu: series(7), filters }));
});
