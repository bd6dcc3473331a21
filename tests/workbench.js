// What tests/test_workbench.py asks the page, in the page.
window.ask = {
  fly(asked) {
    const { core } = workbench, series = (name) => Float64Array.from(asked[name]);
    const flight = core.fly(asked.p, series("r"), series("f_d"), asked.kinds);
    if (!flight) return null;
    const plain = (of, names) => Object.fromEntries(names.map((name) => [name, Array.from(of[name])]));
    const filters = flight.filters.map((of) => plain(of, ["mean", "innovation", "variance"]));
    return { ...plain(flight, ["x", "v", "y", "u", "iu"]), filters };
  },

  rotor([name, settings]) {
    const { rotor } = workbench, machine = workbench.machines.find((one) => one.name === name);
    workbench.pick(machine, settings);
    rotor.compute();
    const { flight } = rotor, plain = (of) => Array.from(of);
    return {
      mean: flight.filters.map((one) => plain(one.mean)), q: flight.q.map(plain), y: plain(flight.y), u: plain(flight.u), iu: plain(flight.iu),
      ...Object.fromEntries(Object.entries(rotor.signals()).map(([name, of]) => [name, plain(of)])),
    };
  },

  rotorKnobs() {
    const { rotor } = workbench, out = {};
    workbench.pick(workbench.machines.find((one) => one.rotor));
    const sum = (series) => series.reduce((all, value, k) => all + value * ((k % 7) + 1), 0);
    const look = () => {
      rotor.compute();
      return { flight: sum(rotor.flight.q[0]), filter: sum(rotor.flight.filters[1].mean) };
    };
    for (const key of rotor.knobs) {
      const before = look(), slider = document.getElementById(`knob-${key}`);
      slider.value = Number(slider.value) < 500 ? 700 : 300;
      slider.dispatchEvent(new Event("input"));
      const after = look();
      slider.dispatchEvent(new Event("dblclick"));
      const back = look().filter === before.filter, finite = Number.isFinite(after.filter);
      out[key] = { moves: before.flight !== after.flight, filter: before.filter !== after.filter, finite, back };
    }
    return out;
  },

  margin([name, feedback]) {
    const machine = workbench.machines.find((one) => one.name === name), p = { ...machine.axis, feedback };
    workbench.choose({ ...workbench.settings, machine, p, reference: 0, kinds: [0] });
    workbench.compute();
    workbench.panels.later.finish();
    return workbench.panels.margin;
  },

  // Turn each knob by its slider: whether it moves the flight and the second filter, and comes back.
  knobs() {
    const sum = (series) => series.reduce((all, value, k) => all + value * ((k % 7) + 1), 0), out = {};
    const look = () => {
      workbench.compute();
      const { flight } = workbench;
      return { flight: sum(flight.x), filters: sum(flight.filters[1].mean) };
    };
    workbench.settings.p.feedback = 0;
    for (const key of workbench.knobs) {
      const before = look(), slider = document.getElementById(`knob-${key}`);
      slider.value = Number(slider.value) < 500 ? 800 : 200;
      slider.dispatchEvent(new Event("input"));
      const after = look(), moves = (what) => before[what] !== after[what];
      slider.dispatchEvent(new Event("dblclick"));
      const back = look().flight === before.flight;
      out[key] = { flight: moves("flight"), filters: moves("filters"), finite: Number.isFinite(after.filters), back };
    }
    return out;
  },

  times() {
    workbench.settings.duration = 1;
    workbench.changed(true);
    const took = Array.from({ length: 12 }, () => {
      const from = performance.now();
      workbench.compute();
      return performance.now() - from;
    });
    return { took, n: workbench.flight.n, filters: workbench.flight.filters.length };
  },
};
