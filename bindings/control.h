// The whole controller of an axis or a machine (ambkit/control.h), with the memory it works on.
#pragma once

#include "estimator.h"

#include <list>

extern "C" {
#include "ambkit/control.h"
}

struct Control {
  // The arrays and numbers of amb_control, amb_controllers and amb_sequence by their names.
  Control(Estimator &of, const nb::dict &given);
  Control(const Control &) = delete; // `control` points into the object

  amb_control control{};
  Estimator &estimator;
  size_t n, m, p, q;

private:
  amb_controllers law{};
  amb_sequence sequence{};
  std::vector<amb_pid> pid;
  std::list<std::vector<amb_real>> kept;
};
