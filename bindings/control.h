// The complete controller of an axis or a machine (ambkit/control.h), with its memory.
#pragma once

#include "estimator.h"

extern "C" {
#include "ambkit/control.h"
}

// A PID from its gains and limits, and the coefficients of its sections.
amb_pid pid_of(nb::handle numbers, amb_real T, Kept &kept);

// amb_controllers with its arrays, from its fields by name.
class Law
{
public:
  Law() = default;
  Law(const Law &) = delete; // `law` points into the object
  // For p axes; input: this number of states or readings.
  void set(const nb::dict &fields, amb_real T, size_t p, size_t seen);
  amb_controllers law{};

private:
  void set_unbalance_control(const nb::dict &fields, size_t p, size_t seen);
  void set_schedule(const nb::dict &fields, size_t q);
  std::vector<amb_pid> pid;
  amb_unbalance_control unbalance_control{};
  amb_gain_schedule schedule{};
  Kept kept;
};

struct Control {
  // The arrays and numbers of amb_control, amb_controllers and amb_sequence by name.
  Control(Estimator &of, const nb::dict &fields);
  Control(const Control &) = delete; // `control` points into the object

  amb_control control{};
  Estimator &estimator;
  size_t n, m, p, q;

private:
  Law law;
  amb_sequence sequence{};
  Kept kept;
};
