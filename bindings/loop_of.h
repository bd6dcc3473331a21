// A closed loop from what Python says of it, for one run and for many.
#pragma once

#include "control.h"

extern "C" {
#include "loop.h"
}

// The parts of a plant, by the names of amb_parts; what is not named is 0.
amb_parts parts_of(const nb::dict &given);

// Plant and controllers of a loop, by the names of amb_plant, and all that they point to.
class LoopOf
{
public:
  LoopOf(const nb::dict &given, Estimator *estimator, Control *control);
  LoopOf(const LoopOf &) = delete; // `loop` points into the object
  // A rotor at rest at q, where these currents [A] have long been, and the controllers with these
  // integrals. A control takes over a rotor that hovers, or is at power-on.
  void settle(amb_loop_state &state, const Vector &q, const Vector &current, const Vector &integral,
              bool hovers, void *estimator) const;
  // That a start has a value for each.
  void check_start(const Vector &q, const Vector &current, const Vector &integral) const;
  size_t axes() const
  {
    return static_cast<size_t>(loop.plant.axes);
  }
  size_t sensors() const
  {
    return static_cast<size_t>(loop.plant.sensors);
  }
  amb_loop loop{};

private:
  void set_plant();
  void set_magnets(size_t p);
  void set_rings();
  void set_controllers(Estimator *estimator);
  amb_real number(const char *name) const;
  int count(const char *name) const;
  const amb_real *numbers(const char *name, size_t n);
  const int *places(const char *name, size_t n, int most, int least);
  amb_rows rows(const char *name, size_t count, size_t columns);
  std::vector<amb_parts> all_parts(const char *name, size_t n) const;

  nb::dict given; // keeps the magnets
  Kept reals;
  std::list<std::vector<int>> ints;
  std::list<std::vector<unsigned short>> shorts;
  std::vector<amb_magnet> magnets, coils;
  std::vector<amb_parts> amplifiers, sensor_parts;
  std::list<amb_parts> stops;
  std::vector<amb_ring> rings;
  Law law;
};

// The faults of a run: arrays by the names of amb_loop_faults, a value a sample and sensor or axis.
class Faults
{
public:
  Faults(const nb::dict &arrays, bool beside, size_t n, const LoopOf &of);
  amb_loop_faults to{};

private:
  std::vector<Samples> kept;
};
