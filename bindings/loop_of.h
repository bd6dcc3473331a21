// A closed loop from what Python says of it, for one run and for many.
#pragma once

#include "control.h"
#include "plant_parts.h"

extern "C" {
#include "loop.h"
}

// What stays the same throughout a run; arguments by the names of sim/loop.h and controller.h.
struct LoopOf {
  amb_parts parts{};
  amb_axis axis{};
  amb_real gain{};
  amb_axis_room room{};
  amb_loop loop{};
  LoopOf(const LoopOf &) = delete; // `loop` points into the object

  LoopOf(const Magnet &magnet, amb_real T, amb_real m, amb_real f_0, amb_real f_bias,
         amb_real K_sen, amb_real T_sen, amb_real travel, int substeps, amb_real k_ui,
         amb_real iu_min, amb_real iu_max, amb_real kp, amb_real ki, amb_real kd, amb_real T_f,
         amb_real T_t, amb_real weight, bool feedback_estimate, Estimator *estimator,
         const std::optional<Named> &given, const Magnet *coil, Control *control)
  {
    if (control != nullptr && &control->estimator != estimator)
      throw std::invalid_argument("the controller has another estimator than the loop");
    if (feedback_estimate && estimator == nullptr)
      throw std::invalid_argument("feedback from the estimate needs an estimator");
    if (estimator != nullptr)
      estimator->must_be_single("the simulated loop");
    if (feedback_estimate)
      estimator->must_have({AMB_POSITION, AMB_VELOCITY}, "feedback from the estimate");
    if (given)
      parts = parts_of(*given);
    axis = {magnet.magnet, m,      f_0,      f_bias, K_sen,
            T_sen,         travel, substeps, &parts, coil ? coil->magnet : amb_magnet{}};
    gain = k_ui;
    loop.plant = amb_plant_of_axis(&axis, &room);
    loop.T = T;
    loop.pid = {T, kp, ki, kd, T_f, T_t, weight, iu_min, iu_max};
    loop.k_ui = &gain;
    loop.iu_min = &loop.pid.iu_min;
    loop.iu_max = &loop.pid.iu_max;
    loop.estimator = estimator ? &estimator->estimator : nullptr;
    loop.feedback_estimate = feedback_estimate;
    loop.control = control ? &control->control : nullptr;
  }

  // Settled at x, with the integral of the controller at this current [A]; a whole controller takes
  // over a rotor that this other current holds, or is at power-on. The estimator has been reset.
  void settle(amb_loop_state &state, amb_real x, amb_real integral, std::optional<amb_real> hover,
              void *estimator) const
  {
    const bool whole = loop.control != nullptr || loop.elsewhere != nullptr;
    const amb_real asked = whole ? hover.value_or(0) : integral;
    const amb_real held = amb_clamp(asked, loop.pid.iu_min, loop.pid.iu_max);
    amb_plant_settle(&loop.plant, &state.plant, x, held);
    amb_pid_reset(&state.pid[0], integral);
    if (loop.control != nullptr && hover)
      amb_control_hover(loop.control, &state.control, &held, &integral);
    else if (loop.control != nullptr)
      amb_control_init(loop.control, &state.control, estimator);
  }
};

// The faults of a run: arrays by the names of amb_loop_faults, which are those of the caller.
class Faults
{
public:
  Faults(const nb::dict &arrays, bool beside, size_t n)
  {
    to = {beside,
          series(arrays, "late", n),
          series(arrays, "y_times", n),
          series(arrays, "y_plus", n),
          series(arrays, "u_times", n),
          series(arrays, "u_plus", n),
          series(arrays, "current", n)};
  }
  amb_loop_faults to{};

private:
  std::vector<Vector> kept;
  const amb_real *series(const nb::dict &arrays, const char *name, size_t n)
  {
    kept.push_back(nb::cast<Vector>(arrays[name]));
    same_length(n, kept.back().size(), name);
    return kept.back().data();
  }
};
