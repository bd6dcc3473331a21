#include "loop_of.h"

namespace
{

// Plant, controller and last sample of a loop, between two stretches of a run; empty at first.
struct LoopState {
  amb_loop_state state{};
};

Named simulate(const Magnet &magnet, amb_real T, amb_real m, amb_real f_0, amb_real K_sen,
               amb_real T_sen, amb_real travel, int substeps, amb_real k_ui, amb_real iu_min,
               amb_real iu_max, amb_real kp, amb_real ki, amb_real kd, amb_real T_f, amb_real T_t,
               amb_real weight, amb_real integral, bool feedback_estimate, Estimator *estimator,
               const Vector &r, const Vector &f_d, const Vector &noise_u, const Vector &noise_y,
               const std::optional<Vector> &scale, amb_real f_bias, amb_real x_start,
               LoopState *went, const std::optional<Named> &faults, bool beside,
               const std::optional<Named> &parts, const Magnet *coil)
{
  const size_t n = r.size();
  same_length(n, f_d.size(), "f_d");
  same_length(n, noise_u.size(), "noise_u");
  same_length(n, noise_y.size(), "noise_y");
  if (scale)
    same_length(n, scale->size(), "scale");
  const LoopOf of(magnet, T, m, f_0, K_sen, T_sen, travel, substeps, k_ui, iu_min, iu_max, kp, ki, kd,
                  T_f, T_t, weight, feedback_estimate, estimator, parts, coil);
  const amb_loop &loop = of.loop;
  const amb_parts &with = of.parts;
  const std::optional<Faults> wrong =
      faults ? std::optional<Faults>(Faults(*faults, beside, n)) : std::nullopt;
  const amb_loop_input input{n,
                             r.data(),
                             f_d.data(),
                             noise_u.data(),
                             noise_y.data(),
                             scale ? scale->data() : nullptr,
                             f_bias,
                             wrong ? &wrong->to : nullptr};
  Fresh<amb_real> x({n}), v({n}), x_m({n}), iu({n}), force({n}), y({n}), u({n});
  const Sizes sizes(estimator ? estimator->kf.model : amb_model{});
  History history(estimator ? n : 0, sizes, estimator != nullptr, estimator && estimator->scales());
  const bool volts = with.voltage > 0;
  Fresh<amb_real> first({volts ? n : 0}), second({volts && with.pair ? n : 0});
  amb_loop_output out{
      x.data,     v.data,
      x_m.data,   iu.data,
      force.data, y.data,
      u.data,     history.to,
      0,          {volts ? first.data : nullptr, volts && with.pair ? second.data : nullptr},
      nullptr};
  LoopState fresh;
  amb_loop_state &state = went ? went->state : fresh.state;
  if (!state.sampled)
    of.settle(state, x_start, integral);
  {
    nb::gil_scoped_release release;
    amb_loop_run(&loop, &input, &state, estimator ? estimator->state() : nullptr, &out);
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
      "A closed-loop run in one call; see sim/loop.h for shapes and units. With a state, an empty "
      "one at first, the next call goes on where this one ends.");
}
