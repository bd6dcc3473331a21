#include "loop_of.h"

namespace
{

// Plant, controller and last sample of a loop, between two stretches of a run; empty at first.
struct LoopState {
  amb_loop_state state{};
};

// A controller in Python, or behind it: a function of y [m], r [m] and whether to fly, that says
// control current [A], control signal [V], whether it is on, and the mode.
using Told = nb::typed<nb::tuple, amb_real, amb_real, bool, int>;
using Asked = nb::typed<nb::callable, Told(amb_real, amb_real, bool)>;

struct Elsewhere {
  nb::callable asked;
  nb::object failed; // what it raised, which ends the run when the GIL is there
  static amb_real ask(void *self, amb_real y, amb_real r, bool fly, amb_control_output *flown)
  {
    auto &at = *static_cast<Elsewhere *>(self);
    *flown = amb_control_output{};
    flown->mode = AMB_OFF;
    nb::gil_scoped_acquire acquire;
    if (at.failed.is_valid())
      return 0;
    try {
      const auto said = nb::cast<nb::tuple>(at.asked(y, r, fly));
      flown->iu[0] = nb::cast<amb_real>(said[0]);
      flown->on = nb::cast<bool>(said[2]);
      flown->mode = static_cast<amb_flight_mode>(nb::cast<int>(said[3]));
      return nb::cast<amb_real>(said[1]);
    } catch (nb::python_error &error) {
      at.failed = nb::borrow(error.value());
      return 0;
    }
  }
};

Named simulate(const Magnet &magnet, amb_real T, amb_real m, amb_real f_0, amb_real K_sen,
               amb_real T_sen, amb_real travel, int substeps, amb_real k_ui, amb_real iu_min,
               amb_real iu_max, amb_real kp, amb_real ki, amb_real kd, amb_real T_f, amb_real T_t,
               amb_real weight, amb_real integral, bool feedback_estimate, Estimator *estimator,
               const Vector &r, const Vector &f_d, const Vector &noise_u, const Vector &noise_y,
               const std::optional<Vector> &scale, amb_real f_bias, amb_real x_start,
               LoopState *went, const std::optional<Named> &faults, bool beside,
               const std::optional<Named> &parts, const Magnet *coil, Control *control,
               const std::optional<Vector> &fly, std::optional<amb_real> hover,
               const std::optional<Asked> &elsewhere)
{
  const size_t n = r.size();
  same_length(n, f_d.size(), "f_d");
  same_length(n, noise_u.size(), "noise_u");
  same_length(n, noise_y.size(), "noise_y");
  if (scale)
    same_length(n, scale->size(), "scale");
  if (fly)
    same_length(n, fly->size(), "fly");
  LoopOf of(magnet, T, m, f_0, f_bias, K_sen, T_sen, travel, substeps, k_ui, iu_min, iu_max, kp, ki,
            kd, T_f, T_t, weight, feedback_estimate, estimator, parts, coil, control);
  Elsewhere asked{elsewhere ? nb::callable(*elsewhere) : nb::callable(), {}};
  of.loop.elsewhere = elsewhere ? &Elsewhere::ask : nullptr;
  of.loop.where = &asked;
  const amb_loop &loop = of.loop;
  const amb_parts &with = of.parts;
  const std::optional<Faults> wrong =
      faults ? std::optional<Faults>(Faults(*faults, beside, n)) : std::nullopt;
  amb_loop_input input{};
  input.n = n;
  input.off = n;
  input.r = r.data();
  input.load = f_d.data();
  input.noise_u = noise_u.data();
  input.noise_y = noise_y.data();
  input.scale = scale ? scale->data() : nullptr;
  input.faults = wrong ? &wrong->to : nullptr;
  input.fly = fly ? fly->data() : nullptr;
  Fresh<amb_real> x({n}), v({n}), x_m({n}), iu({n}), force({n}), y({n}), u({n});
  const Sizes sizes(estimator ? estimator->kf.model : amb_model{});
  History history(estimator ? n : 0, sizes, estimator != nullptr, estimator && estimator->scales());
  const bool volts = with.voltage > 0;
  Fresh<amb_real> first({volts ? n : 0}), second({volts && with.pair ? n : 0});
  const bool whole = control != nullptr || elsewhere;
  Fresh<unsigned char> mode({whole ? n : 0});
  amb_real *const X[] = {x.data, v.data, x_m.data};
  amb_loop_output out{};
  out.X = X;
  out.columns = 3;
  out.iu = iu.data;
  out.force = force.data;
  out.y = y.data;
  out.u = u.data;
  out.estimate = history.to;
  out.voltage[0] = volts ? first.data : nullptr;
  out.voltage[1] = volts && with.pair ? second.data : nullptr;
  out.mode = whole ? mode.data : nullptr;
  LoopState fresh;
  amb_loop_state &state = went ? went->state : fresh.state;
  if (!state.sampled)
    of.settle(state, x_start, integral, hover, estimator ? estimator->state() : nullptr);
  {
    nb::gil_scoped_release release;
    amb_loop_run(&loop, &input, &state, estimator ? estimator->state() : nullptr, &out);
    for (size_t k = 0; k < n; k++)
      force.data[k] += f_0;
  }
  if (asked.failed.is_valid()) {
    PyErr_SetObject(reinterpret_cast<PyObject *>(asked.failed.type().ptr()), asked.failed.ptr());
    throw nb::python_error();
  }
  nb::dict d;
  d["x"] = x.array;
  d["v"] = v.array;
  d["x_m"] = x_m.array;
  d["iu"] = iu.array;
  d["force"] = force.array;
  d["y"] = y.array;
  d["u"] = u.array;
  if (out.voltage[0] != nullptr)
    d["u_coil"] = first.array;
  if (out.voltage[1] != nullptr)
    d["u_coil_2"] = second.array;
  d["touched"] = out.touched;
  if (whole)
    d["mode"] = mode.array;
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
  m.def(
      "simulate", &simulate, nb::arg("magnet"), nb::kw_only(), nb::arg("T"), nb::arg("m"),
      nb::arg("f_0"), nb::arg("K_sen"), nb::arg("T_sen"), nb::arg("travel"), nb::arg("substeps"),
      nb::arg("k_ui"), nb::arg("iu_min"), nb::arg("iu_max"), nb::arg("kp"), nb::arg("ki"),
      nb::arg("kd"), nb::arg("T_f"), nb::arg("T_t"), nb::arg("weight") = amb_real(1),
      nb::arg("integral"), nb::arg("feedback_estimate"), nb::arg("estimator").none(), nb::arg("r"),
      nb::arg("f_d"), nb::arg("noise_u"), nb::arg("noise_y"), nb::arg("scale").none() = nb::none(),
      nb::arg("f_bias") = 0, nb::arg("x_start") = 0, nb::arg("state").none() = nb::none(),
      nb::arg("faults").none() = nb::none(), nb::arg("beside") = false,
      nb::arg("parts").none() = nb::none(), nb::arg("coil").none() = nb::none(),
      nb::arg("control").none() = nb::none(), nb::arg("fly").none() = nb::none(),
      nb::arg("hover").none() = nb::none(), nb::arg("elsewhere").none() = nb::none(),
      "A closed-loop run in one call; see sim/loop.h for shapes and units. With a state, an empty "
      "one at first, the next call goes on where this one ends. A whole controller starts in "
      "flight, "
      "with this current [A] (hover), or at power-on.");
}
