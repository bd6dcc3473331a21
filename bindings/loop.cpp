#include "loop_of.h"

namespace
{

// State of plant and controller and the last sample of a loop, between two parts of a run; empty at
// first.
struct LoopState {
  amb_loop_state state{};
};

Named simulate(const nb::dict &fields, const nb::kwargs &arguments)
{
  Arguments named(arguments);
  ClosedLoop closed_loop(fields, named);
  const amb_loop &loop = closed_loop.of.loop;
  Estimator *estimator = closed_loop.estimator;
  const size_t p = closed_loop.of.axes(), m = closed_loop.of.sensors(), n = closed_loop.in.n;
  amb_loop_input input = closed_loop.in;
  input.noise_u = closed_loop.series(named.take("noise_u"), n, p, "noise_u");
  input.noise_y = closed_loop.series(named.take("noise_y"), n, m, "noise_y");
  auto *went = named.or_else<LoopState *>("state", nullptr);
  const auto start = named.or_else<std::optional<Vector>>("start", std::nullopt);
  named.done();
  const auto columns = static_cast<size_t>(loop.plant.own ? 3 : loop.plant.states);
  Fresh<amb_real> X({columns, n}), iu({n, p}), force({n, p}), y({n, m}), u({n, p});
  std::vector<amb_real *> states;
  for (size_t j = 0; j < columns; j++)
    states.push_back(X.data + j * n);
  const Sizes sizes(estimator ? estimator->kf.model : amb_model{});
  History history(estimator ? n : 0, sizes, estimator != nullptr, estimator && estimator->scales());
  const amb_parts &coil = loop.plant.amplifier[0];
  const bool volts = p == 1 && coil.voltage > 0, both = volts && coil.pair;
  const bool controlled = closed_loop.control != nullptr;
  Fresh<amb_real> first({volts ? n : 0}), second({both ? n : 0});
  Fresh<unsigned short> status({n});
  Fresh<unsigned char> at_stop({n}), mode({controlled ? n : 0}), usable({controlled ? n : 0});
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
  out.at_stop = at_stop.data;
  out.mode = controlled ? mode.data : nullptr;
  out.usable = controlled ? usable.data : nullptr;
  LoopState fresh;
  amb_loop_state &state = went ? went->state : fresh.state;
  if (!state.sampled)
    closed_loop.settle(state, estimator ? estimator->state() : nullptr);
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
  d["at_stop"] = at_stop.array;
  if (volts)
    d["u_coil"] = first.array;
  if (both)
    d["u_coil_2"] = second.array;
  if (controlled) {
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
  m.def("simulate", &simulate, nb::arg("loop"), nb::arg("named"),
        nb::sig(
            "def simulate(loop: dict[str, Any], *, r: Any, load: Any, noise_u: Any, noise_y: "
            "Any, place: Any, current: Any, integral: Any, hovers: bool = True, estimator: "
            "Estimator | None = None, model: Model | None = None, control: Control | None = "
            "None, speed: Any = None, rotation: Any = None, base: Any = None, on: Any = None, "
            "scale: Any = "
            "None, faults: dict[str, Any] | None = None, beside: bool = False, fly: Any = "
            "None, state: LoopState | None = None, start: Any = None, own_controller: Any = None, "
            "own_plant: Any = None) "
            "-> dict[str, Any]"),
        "A closed-loop run in one call; see sim/loop.h for shapes and units. With a state, an "
        "empty one at first, the next call goes on where this one ends. The start, of all states "
        "of the "
        "plant, is in place of rest.");
}
