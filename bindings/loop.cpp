#include "loop_of.h"

namespace
{

// Plant, controller and last sample of a loop, between two stretches of a run; empty at first.
struct LoopState {
  amb_loop_state state{};
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

// A controller or a plant in Python, around numbers of C. What is called raises nothing, and
// returns as many numbers as there are (control/user_controller.py, simulation/external_inputs.py).
struct OwnOf {
  nb::callable answer;
  size_t given[3], answers;
  std::vector<size_t> places; // of the answer's numbers
  bool ask(std::initializer_list<const amb_real *> from, amb_real to[]) const
  {
    nb::gil_scoped_acquire acquire;
    nb::list arguments[3];
    size_t at = 0;
    for (const amb_real *numbers : from) {
      for (size_t i = 0; (numbers != nullptr) && (i < given[at]); i++)
        arguments[at].append(numbers[i]);
      at++;
    }
    const nb::object result = answer(arguments[0], arguments[1], arguments[2]);
    for (size_t i = 0; i < answers; i++)
      to[places[i]] = nb::cast<amb_real>(result[i]);
    return nb::len(result) > answers && nb::cast<amb_real>(result[answers]) > 0;
  }
  static void control(void *self, const amb_real y[], const amb_real r[], const amb_real mean[],
                      amb_real iu[])
  {
    (void)static_cast<const OwnOf *>(self)->ask({y, r, mean}, iu);
  }
  static bool move(void *self, const amb_real iu[], const amb_real load[], amb_real X[])
  {
    return static_cast<const OwnOf *>(self)->ask({iu, load, nullptr}, X);
  }
};

// An array of a run that may be absent, checked.
const amb_real *series(const std::optional<Samples> &given, size_t n, size_t columns,
                       const char *name)
{
  if (!given)
    return nullptr;
  same_length(n, samples_of(*given, columns, name), name);
  return given->data();
}

Named simulate(const nb::dict &given, const Samples &r, const Samples &load, const Samples &noise_u,
               const Samples &noise_y, const Vector &place, const Vector &current,
               const Vector &integral, bool hovers, Estimator *estimator, Model *model,
               Control *control, const std::optional<Samples> &speed,
               const std::optional<Samples> &base, std::optional<size_t> off,
               const std::optional<Samples> &scale, const std::optional<Named> &faults, bool beside,
               const std::optional<Samples> &fly, LoopState *went,
               const std::optional<Vector> &start,
               const std::optional<nb::callable> &own_controller,
               const std::optional<nb::callable> &own_plant)
{
  LoopOf of(given, estimator, control);
  amb_loop &loop = of.loop;
  const size_t p = of.axes(), m = of.sensors(), n = samples_of(r, p, "r");
  of.check_start(place, current, integral);
  const std::optional<Faults> wrong =
      faults ? std::optional<Faults>(std::in_place, *faults, beside, n, of) : std::nullopt;
  amb_loop_input input{};
  input.n = n;
  input.r = r.data();
  input.load = series(load, n, p, "load");
  input.noise_u = series(noise_u, n, p, "noise_u");
  input.noise_y = series(noise_y, n, m, "noise_y");
  input.speed = series(speed, n + 1, 1, "speed");
  input.base = series(base, n, 3, "base");
  input.scale = series(scale, n, 1, "scale");
  input.fly = series(fly, n, 1, "fly");
  input.faults = wrong ? &wrong->to : nullptr;
  input.off = off.value_or(n);
  if (!loop.plant.own && input.speed == nullptr)
    throw std::invalid_argument("a plant of several axes needs a speed");
#if defined(AMB_MODEL_LOOPS)
  Turning turning{estimator, model};
  if (estimator != nullptr && model != nullptr && model->turns()) {
    if (input.speed == nullptr)
      throw std::invalid_argument("a model that turns needs a speed");
    loop.turn = &Turning::turn;
    loop.model = &turning;
  }
#else
  (void)model; // a single axis does not turn
#endif
  std::optional<OwnOf> controller, plant;
  if (own_controller) {
    const size_t states = estimator ? static_cast<size_t>(amb_states(&estimator->kf.model)) : 0;
    controller.emplace(OwnOf{*own_controller, {m, p, states}, p, {}});
    for (size_t c = 0; c < p; c++)
      controller->places.push_back(c);
    loop.own.control = &OwnOf::control;
    loop.own.controller = &*controller;
  }
  if (own_plant) {
    plant.emplace(OwnOf{*own_plant, {p, p, 0}, 0, {}});
    for (int j = 0; j < (loop.plant.own ? 2 : 2 * loop.plant.positions); j++)
      plant->places.push_back(static_cast<size_t>(j));
    for (size_t r = 0; r < m; r++)
      plant->places.push_back(static_cast<size_t>(loop.plant.shows[r]));
    plant->answers = plant->places.size();
    loop.own.move = &OwnOf::move;
    loop.own.plant = &*plant;
  }
  const auto columns = static_cast<size_t>(loop.plant.own ? 3 : loop.plant.states);
  Fresh<amb_real> X({columns, n}), iu({n, p}), force({n, p}), y({n, m}), u({n, p});
  std::vector<amb_real *> states;
  for (size_t j = 0; j < columns; j++)
    states.push_back(X.data + j * n);
  const Sizes sizes(estimator ? estimator->kf.model : amb_model{});
  History history(estimator ? n : 0, sizes, estimator != nullptr, estimator && estimator->scales());
  const amb_parts &coil = loop.plant.amplifier[0];
  const bool volts = p == 1 && coil.voltage > 0, both = volts && coil.pair;
  const bool whole = control != nullptr;
  Fresh<amb_real> first({volts ? n : 0}), second({both ? n : 0});
  Fresh<unsigned short> status({n});
  Fresh<unsigned char> mode({whole ? n : 0}), usable({whole ? n : 0});
  amb_loop_output out{};
  out.X = states.data();
  out.columns = static_cast<int>(columns);
  out.iu = iu.data;
  out.force = force.data;
  out.y = y.data;
  out.u = u.data;
  out.estimate = history.to;
  out.voltage[0] = volts ? first.data : nullptr;
  out.voltage[1] = both ? second.data : nullptr;
  out.status = status.data;
  out.mode = whole ? mode.data : nullptr;
  out.usable = whole ? usable.data : nullptr;
  LoopState fresh;
  amb_loop_state &state = went ? went->state : fresh.state;
  if (!state.sampled)
    of.settle(state, place, current, integral, hovers, estimator ? estimator->state() : nullptr);
  if (start) {
    same_length(static_cast<size_t>(loop.plant.states), start->size(), "start");
    std::copy_n(start->data(), start->size(), state.plant.X);
  }
  {
    nb::gil_scoped_release release;
    amb_loop_run(&loop, &input, &state, estimator ? estimator->state() : nullptr, &out);
  }
  nb::dict d;
  d["X"] = X.array;
  d["iu"] = iu.array;
  d["force"] = force.array;
  d["y"] = y.array;
  d["u"] = u.array;
  d["status"] = status.array;
  d["touched"] = out.touched;
  d["first"] = out.first;
  if (volts)
    d["u_coil"] = first.array;
  if (both)
    d["u_coil_2"] = second.array;
  if (whole) {
    d["mode"] = mode.array;
    d["usable"] = usable.array;
  }
  if (estimator)
    d["estimate"] = history.arrays;
  return d;
}

} // namespace

void bind_loop(nb::module_ &m)
{
  nb::class_<LoopState>(m, "LoopState",
                        "Plant, controller and last sample of a closed loop; empty at first.")
      .def(nb::init<>());
  m.def("simulate", &simulate, nb::arg("loop"), nb::kw_only(), nb::arg("r"), nb::arg("load"),
        nb::arg("noise_u"), nb::arg("noise_y"), nb::arg("place"), nb::arg("current"),
        nb::arg("integral"), nb::arg("hovers") = true, nb::arg("estimator").none() = nb::none(),
        nb::arg("model").none() = nb::none(), nb::arg("control").none() = nb::none(),
        nb::arg("speed").none() = nb::none(), nb::arg("base").none() = nb::none(),
        nb::arg("off").none() = nb::none(), nb::arg("scale").none() = nb::none(),
        nb::arg("faults").none() = nb::none(), nb::arg("beside") = false,
        nb::arg("fly").none() = nb::none(), nb::arg("state").none() = nb::none(),
        nb::arg("start").none() = nb::none(), nb::arg("own_controller").none() = nb::none(),
        nb::arg("own_plant").none() = nb::none(),
        nb::sig(
            "def simulate(loop: dict[str, Any], *, r: Any, load: Any, noise_u: Any, noise_y: "
            "Any, place: Any, current: Any, integral: Any, hovers: bool = True, estimator: "
            "Estimator | None = None, model: Model | None = None, control: Control | None = "
            "None, speed: Any = None, base: Any = None, off: int | None = None, scale: Any = "
            "None, faults: dict[str, Any] | None = None, beside: bool = False, fly: Any = "
            "None, state: LoopState | None = None, start: Any = None, own_controller: Any = None, "
            "own_plant: Any = None) "
            "-> dict[str, Any]"),
        "A closed-loop run in one call; see sim/loop.h for shapes and units. With a state, an "
        "empty one at first, the next call goes on where this one ends. The start, of all states "
        "of the "
        "plant, is in place of rest.");
}
