// A machine in closed loop, of any pattern (sim/loop.h).
#include "control.h"
#include "plant_parts.h"

extern "C" {
#include "loop.h"
}

namespace
{

// The arrays of a machine, by the names of the fields of amb_plant and amb_loop.
class Arrays
{
public:
  explicit Arrays(const nb::dict &given) : given(given)
  {
  }
  amb_real number(const char *name) const
  {
    return nb::cast<amb_real>(given[name]);
  }
  bool has(const char *name) const
  {
    return given.contains(name);
  }
  int count(const char *name) const
  {
    return nb::cast<int>(given[name]);
  }
  const amb_real *numbers(const char *name, size_t n)
  {
    return reals.numbers(given, name, n);
  }
  const int *places(const char *name, size_t n, size_t most, int least)
  {
    ints.push_back(nb::cast<std::vector<int>>(given[name]));
    same_length(n, ints.back().size(), name);
    for (const int at : ints.back())
      if (at < least || at >= static_cast<int>(most))
        throw std::invalid_argument(std::string(name) + " is out of range");
    return ints.back().data();
  }
  amb_rows rows(const char *name, size_t count, size_t columns)
  {
    const auto parts = nb::cast<nb::tuple>(given[name]); // start, column, value
    shorts.push_back(nb::cast<std::vector<unsigned short>>(parts[0]));
    const std::vector<unsigned short> &start = shorts.back();
    shorts.push_back(nb::cast<std::vector<unsigned short>>(parts[1]));
    const std::vector<unsigned short> &column = shorts.back();
    same_length(count + 1, start.size(), name);
    same_length(start.back(), column.size(), name);
    const amb_real *value = reals.keep(parts[2], start.back(), name);
    for (size_t i = 0; i < count; i++)
      if (start[i + 1] < start[i])
        throw std::invalid_argument(std::string(name) + ": rows must ascend");
    for (const unsigned short at : column)
      if (at >= columns)
        throw std::invalid_argument(std::string(name) + ": a column is out of range");
    return {start.data(), column.data(), value};
  }
  nb::handle operator[](const char *name) const
  {
    held.push_back(given[name]);
    return held.back();
  }

private:
  nb::dict given;
  mutable std::vector<nb::object> held;
  Kept reals;
  std::list<std::vector<int>> ints;
  std::list<std::vector<unsigned short>> shorts;
};

// The machine and its controllers, and all that they point to.
struct Whole {
  explicit Whole(const nb::dict &given, const Estimator *estimator) : arrays(given)
  {
    const auto within = [](size_t n, size_t most, const char *what) {
      if (n < 1 || n > most)
        throw std::invalid_argument("a machine has 1 to " + std::to_string(most) + " " + what +
                                    ", got " + std::to_string(n));
      return n;
    };
    amb_plant &at = loop.plant;
    n = within(static_cast<size_t>(arrays.count("states")), AMB_STATES, "states");
    p = within(static_cast<size_t>(arrays.count("axes")), AMB_FORCES, "axes");
    m = within(static_cast<size_t>(arrays.count("sensors")), AMB_SENSORS, "sensors");
    const size_t q = within(static_cast<size_t>(arrays.count("positions")), n / 2, "positions");
    at.positions = static_cast<int>(q);
    at.states = static_cast<int>(n);
    at.axes = static_cast<int>(p);
    at.sensors = static_cast<int>(m);
    at.H = arrays.rows("H", p, q);
    at.B = arrays.rows("B", q, p);
    at.C = arrays.rows("C", m, q);
    at.A = arrays.rows("A", q, 2 * q);
    at.spin = arrays.numbers("spin", at.A.start[q]);
    at.current = arrays.places("current", p, n, -1);
    at.second = arrays.places("second", p, n, -1);
    at.base = arrays.places("base", 3, q, -1);
    at.bias = arrays.numbers("bias", p);
    at.farthest = arrays.numbers("farthest", p);
    at.g = arrays.numbers("g", q);
    if (arrays.has("cosine")) {
      at.cosine = arrays.numbers("cosine", q);
      at.sine = arrays.numbers("sine", q);
    }
    at.shows = arrays.places("shows", m, n, 0);
    at.gain = arrays.numbers("gain", m);
    at.lag = arrays.numbers("lag", m);
    for (const auto each : nb::cast<nb::list>(arrays["magnets"]))
      magnets.push_back(nb::cast<const Magnet &>(each).magnet);
    same_length(p, magnets.size(), "magnets");
    at.magnet = magnets.data();
    for (const auto each : nb::cast<nb::list>(arrays["coils"]))
      coils.push_back(each.is_none() ? amb_magnet{} : nb::cast<const Magnet &>(each).magnet);
    same_length(p, coils.size(), "coils");
    at.coil = coils.data();
    for (const auto each : nb::cast<nb::list>(arrays["amplifiers"]))
      amplifiers.push_back(parts_of(nb::cast<nb::dict>(each)));
    same_length(p, amplifiers.size(), "amplifiers");
    for (size_t f = 0; f < p; f++)
      if ((amplifiers[f].corner > 0 || at.second[f] >= 0) && at.current[f] < 0)
        throw std::invalid_argument("an amplifier that lags has no current");
    const auto behind = nb::cast<nb::list>(arrays["behind"]);
    same_length(p, behind.size(), "behind");
    for (size_t f = 0; f < p; f++) {
      const auto where = nb::cast<std::vector<int>>(behind[f]);
      same_length(static_cast<size_t>(amplifiers[f].behind), where.size(), "behind");
      for (size_t k = 0; k < where.size(); k++) {
        if (where[k] < 0 || where[k] >= at.states)
          throw std::invalid_argument("behind: there is no such state");
        amplifiers[f].behind_at[k] = where[k];
      }
    }
    at.amplifier = amplifiers.data();
    for (const auto each : nb::cast<nb::list>(arrays["sensor_parts"]))
      sensors.push_back(parts_of(nb::cast<nb::dict>(each)));
    same_length(m, sensors.size(), "sensor_parts");
    at.sensor = sensors.data();
    for (const auto each : nb::cast<nb::list>(arrays["rings"])) {
      const auto ring = nb::cast<nb::dict>(each);
      const int first = nb::cast<int>(ring["first"]), second = nb::cast<int>(ring["second"]);
      if (first < 0 || first >= at.axes || second < -1 || second >= at.axes)
        throw std::invalid_argument("a ring is about axes that are not there");
      stops.push_back(parts_of(nb::cast<nb::dict>(ring["stop"])));
      rings.push_back({first, second, nb::cast<amb_real>(ring["travel"]), &stops.back()});
    }
    at.rings = static_cast<int>(rings.size());
    at.ring = rings.data();
    at.delay = arrays.count("delay");
    at.delay_rest = arrays.number("delay_rest");
    at.substeps = arrays.count("substeps");
    if (at.delay < 0 || at.delay > AMB_DELAY_MOST || at.substeps < 1)
      throw std::invalid_argument("delay or substeps out of range");
    loop.T = arrays.number("T");
    loop.k_ui = arrays.numbers("k_ui", p);
    loop.feedback_estimate = nb::cast<bool>(arrays["feedback_estimate"]);
    if (estimator != nullptr) {
      loop.estimator = &estimator->estimator;
      const Sizes of = estimator->sizes();
      same_length(m, of.sensors, "the estimator, in sensors,");
      same_length(p, of.controls, "the estimator, in controls,");
    }
    if (loop.feedback_estimate && estimator == nullptr)
      throw std::invalid_argument("feedback from the estimate needs an estimator");
    law.set(given, loop.T, p, loop.feedback_estimate ? estimator->sizes().states : m);
    loop.controllers = &law.law;
    loop.iu_min = law.law.iu_min;
    loop.iu_max = law.law.iu_max;
  }
  amb_loop loop{};
  size_t n, p, m;
  Arrays arrays;

private:
  std::vector<amb_magnet> magnets, coils;
  std::vector<amb_parts> amplifiers;
  std::vector<amb_parts> sensors;
  std::list<amb_parts> stops;
  std::vector<amb_ring> rings;
  Law law;
};

#if defined(AMB_MODEL_LOOPS)
// An estimator, and the model that turns with the rotor.
struct Turning {
  Estimator *estimator;
  Model *model;
  static void turn(void *self, amb_real before, amb_real after)
  {
    const auto &both = *static_cast<Turning *>(self);
    both.estimator->turn(*both.model, before, after);
  }
};
#endif

Named simulate_machine(const nb::dict &machine, const Samples &r, const Samples &load,
                       const Samples &base, const Vector &speed, const Samples &noise_u,
                       const Samples &noise_y, const Vector &start, const Vector &demanded,
                       const Vector &integral, Estimator *estimator, Model *model, Control *control,
                       const std::optional<Vector> &fly, bool hovers)
{
  Whole whole(machine, estimator);
  if (control != nullptr) {
    if (&control->estimator != estimator)
      throw std::invalid_argument("the controller has another estimator than the loop");
    whole.loop.control = &control->control;
  }
#if defined(AMB_MODEL_LOOPS)
  Turning turning{estimator, model};
  if (estimator != nullptr && model != nullptr && model->turns()) {
    whole.loop.turn = &Turning::turn;
    whole.loop.model = &turning;
  }
#else
  (void)model; // a single axis does not turn
#endif
  const size_t p = whole.p, m = whole.m, n = samples_of(load, p, "load");
  const auto q = static_cast<size_t>(whole.loop.controllers->pids);
  same_length(n, samples_of(r, p, "r"), "r");
  same_length(n, samples_of(base, 3, "base"), "base");
  same_length(n + 1, speed.size(), "speed");
  same_length(n, samples_of(noise_u, p, "noise_u"), "noise_u");
  same_length(n, samples_of(noise_y, m, "noise_y"), "noise_y");
  same_length(whole.n, start.size(), "start");
  same_length(p, demanded.size(), "demanded");
  same_length(q, integral.size(), "integral");
  if (fly)
    same_length(n, fly->size(), "fly");
  amb_loop_state state{};
  std::copy_n(start.data(), whole.n, state.plant.X);
  state.plant.cosine = 1;
  for (auto &past : state.plant.demanded)
    std::copy_n(demanded.data(), p, past);
  for (size_t c = 0; c < q; c++)
    amb_pid_reset(&state.pid[c], integral.data()[c]);
  if (control != nullptr && hovers)
    amb_control_hover(&control->control, &state.control, demanded.data(), integral.data());
  else if (control != nullptr)
    amb_control_init(&control->control, &state.control, estimator->state());
  if (control != nullptr)
    std::copy_n(state.control.u, p, state.u);
  Fresh<amb_real> X({whole.n, n}), iu({n, p}), force({n, p}), y({n, m}), u({n, p});
  std::vector<amb_real *> columns;
  for (size_t j = 0; j < whole.n; j++)
    columns.push_back(X.data + j * n);
  const Sizes of(estimator ? estimator->kf.model : amb_model{});
  History history(estimator ? n : 0, of, estimator != nullptr, estimator && estimator->scales());
  Fresh<unsigned short> status({n});
  Fresh<unsigned char> mode({control != nullptr ? n : 0}), usable({control != nullptr ? n : 0});
  amb_loop_input input{};
  input.n = n;
  input.r = r.data();
  input.load = load.data();
  input.noise_u = noise_u.data();
  input.noise_y = noise_y.data();
  input.fly = fly ? fly->data() : nullptr;
  input.speed = speed.data();
  input.base = base.data();
  input.off = nb::cast<size_t>(machine["off"]);
  amb_loop_output out{};
  out.X = columns.data();
  out.columns = static_cast<int>(whole.n);
  out.iu = iu.data;
  out.force = force.data;
  out.y = y.data;
  out.u = u.data;
  out.estimate = history.to;
  out.status = status.data;
  out.mode = control ? mode.data : nullptr;
  out.usable = control ? usable.data : nullptr;
  {
    nb::gil_scoped_release release;
    amb_loop_run(&whole.loop, &input, &state, estimator ? estimator->state() : nullptr, &out);
  }
  nb::dict d;
  d["X"] = nb::cast(X.array).attr("T"); // n x states
  d["iu"] = iu.array;
  d["force"] = force.array;
  d["y"] = y.array;
  d["u"] = u.array;
  d["touched"] = out.touched;
  d["first"] = out.first;
  d["status"] = status.array;
  if (control != nullptr) {
    d["mode"] = mode.array;
    d["usable"] = usable.array;
  }
  if (estimator)
    d["estimate"] = history.arrays;
  return d;
}

} // namespace

void bind_machine(nb::module_ &m)
{
  m.def("simulate_machine", &simulate_machine, nb::arg("machine"), nb::kw_only(), nb::arg("r"),
        nb::arg("load"), nb::arg("base"), nb::arg("speed"), nb::arg("noise_u"), nb::arg("noise_y"),
        nb::arg("start"), nb::arg("demanded"), nb::arg("integral"),
        nb::arg("estimator").none() = nb::none(), nb::arg("model").none() = nb::none(),
        nb::arg("control").none() = nb::none(), nb::arg("fly").none() = nb::none(),
        nb::arg("hovers") = false,
        nb::sig(
            "def simulate_machine(machine: dict[str, Any], *, r: Any, load: Any, base: Any, "
            "speed: Any, "
            "noise_u: Any, noise_y: Any, start: Any, demanded: Any, integral: Any, estimator: "
            "Estimator | None = None, model: Model | None = None, control: Control | None = None, "
            "fly: Any = None, hovers: bool = False) -> dict[str, Any]"),
        "A closed-loop run of a whole machine in one call; see sim/loop.h for shapes and units.");
}
