// The parts of a plant, from Python.
#pragma once

#include "estimator.h"

extern "C" {
#include "parts.h"
}

// The parts of a plant, by the names of amb_parts, which are those of the caller; what is not named
// is 0.
inline amb_parts parts_of(const nb::dict &given)
{
  amb_parts parts{};
  nb::dict rest;
  rest.update(given);
  const auto take = [&rest](const char *name, auto &to) {
    if (rest.contains(name)) {
      to = nb::cast<std::decay_t<decltype(to)>>(rest[name]);
      nb::del(rest[name]);
    }
  };
  const auto take_each = [&](const char *name, int count, amb_real *to) {
    if (rest.contains(name)) {
      const Vector values = nb::cast<Vector>(rest[name]);
      same_length(static_cast<size_t>(count), values.size(), name);
      std::copy_n(values.data(), values.size(), to);
      nb::del(rest[name]);
    }
  };
  take("corner", parts.corner);
  take("voltage", parts.voltage);
  take("R", parts.R);
  take("k", parts.k);
  take("s0", parts.s0);
  take("i0", parts.i0);
  take("pair", parts.pair);
  take("behind", parts.behind);
  take("behind_d", parts.behind_d);
  take("delay", parts.delay);
  take("delay_rest", parts.delay_rest);
  take("quadratic", parts.quadratic);
  take("cubic", parts.cubic);
  take("step", parts.step);
  take("rise", parts.rise);
  take("orders", parts.orders);
  take("speed", parts.speed);
  take("stiffness", parts.stiffness);
  take("damping", parts.damping);
  take("farthest", parts.farthest);
  if (parts.orders < 0 || parts.orders > AMB_RUNOUT_MOST)
    throw std::invalid_argument("orders must be 0 to " + std::to_string(AMB_RUNOUT_MOST));
  if (parts.delay < 0 || parts.delay > AMB_DELAY_MOST)
    throw std::invalid_argument("delay must be 0 to " + std::to_string(AMB_DELAY_MOST) +
                                " samples");
  if (parts.behind < 0 || parts.behind > AMB_BEHIND_MOST)
    throw std::invalid_argument("a plant has 0 to " + std::to_string(AMB_BEHIND_MOST) +
                                " states between a magnet and the rotor");
  take_each("runout_cosine", parts.orders, parts.runout_cosine);
  take_each("runout_sine", parts.orders, parts.runout_sine);
  take_each("behind_A", parts.behind * parts.behind, parts.behind_A);
  take_each("behind_b", parts.behind, parts.behind_b);
  take_each("behind_c", parts.behind, parts.behind_c);
  take_each("behind_rest", parts.behind, parts.behind_rest);
  for (const auto &[name, value] : rest)
    throw std::invalid_argument(std::string("a plant has no part ") + nb::str(name).c_str());
  return parts;
}
