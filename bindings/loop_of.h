// A closed loop from its Python description, for one run and for many.
#pragma once

#include "control.h"

extern "C" {
#include "loop.h"
}

// The parts of a plant, with the names of amb_parts; others are 0.
amb_parts parts_of(const nb::dict &fields);

// Rows of entries from a tuple of start, column and value.
struct Rows {
  Rows(const nb::tuple &parts, size_t count, size_t columns, const char *name);
  Rows(const Rows &) = delete; // `to` points into the object
  amb_sparse to{};

private:
  std::vector<unsigned short> start, column;
  std::vector<amb_real> value;
};

// Plant and controllers of a loop, with the names of amb_plant, and their arrays.
class LoopOf
{
public:
  LoopOf(const nb::dict &fields, Estimator *estimator, Control *control);
  LoopOf(const LoopOf &) = delete; // `loop` points into the object
  // A rotor in equilibrium at q with these currents [A], and controllers with these integrals. A
  // complete controller starts levitated, or at power-on.
  void settle(amb_loop_state &state, const Vector &q, const Vector &current, const Vector &integral,
              bool hovers, void *estimator) const;
  // Check that a start has a value for each.
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
  void couple(int first, int second, const nb::dict &fields);
  void set_controllers(Estimator *estimator);
  amb_real number(const char *name) const;
  int count(const char *name) const;
  const amb_real *numbers(const char *name, size_t n);
  const int *places(const char *name, size_t n, int most, int least);
  amb_sparse rows(const char *name, size_t count, size_t columns);
  std::vector<amb_parts> all_parts(const char *name, size_t n) const;

  nb::dict fields; // owns the magnets
  Kept reals;
  std::list<std::vector<int>> ints;
  std::list<Rows> all_rows;
  std::vector<amb_magnet> magnets, coils;
  std::vector<amb_parts> amplifiers, sensor_parts;
  std::list<amb_parts> stops;
  std::vector<amb_ring> rings;
  std::vector<amb_coupling> couplings;
  Law law;
};

// The arguments of a call by name; unknown names are errors.
class Arguments
{
public:
  explicit Arguments(const nb::dict &fields) : all(fields)
  {
  }
  nb::object take(const char *name)
  {
    PyObject *value = PyDict_GetItemString(all.ptr(), name); // borrowed
    if (value == nullptr)
      return nb::none();
    taken.push_back(name);
    return nb::borrow(value);
  }
  template <typename T> T must(const char *name)
  {
    const nb::object value = take(name);
    if (value.is_none())
      throw std::invalid_argument(std::string(name) + " is missing");
    return nb::cast<T>(value);
  }
  template <typename T> T or_else(const char *name, T otherwise)
  {
    const nb::object value = take(name);
    return value.is_none() ? otherwise : nb::cast<T>(value);
  }
  void done() const
  {
    if (taken.size() == all.size())
      return;
    for (const auto &[name, value] : all)
      if (std::find(taken.begin(), taken.end(), std::string_view(nb::str(name).c_str())) ==
          taken.end())
        throw nb::type_error(
            (std::string("there is no argument ") + nb::str(name).c_str()).c_str());
  }

private:
  nb::dict all;
  std::vector<std::string_view> taken;
};

// The faults of a run: arrays with the names of amb_loop_faults, a value per sample and sensor or
// axis.
class Faults
{
public:
  Faults(const nb::dict &arrays, bool beside, size_t n, const LoopOf &of);
  amb_loop_faults to{};

private:
  std::vector<Samples> kept;
};

// A controller or plant in Python, for numbers of C. The function raises no exception, and returns
// the required number of values (control/controller_states.py, simulation/external_inputs.py).
struct OwnOf {
  nb::callable answer;
  size_t counts[3], answers;
  std::vector<size_t> places; // indices of the returned numbers
  bool ask(std::initializer_list<const amb_real *> from, amb_real to[]) const;
};

// A loop, its start, and all external inputs except noise.
class ClosedLoop
{
public:
  ClosedLoop(const nb::dict &loop, Arguments &named);
  ClosedLoop(const ClosedLoop &) = delete; // `in` and the loop point into the object
  void settle(amb_loop_state &state, void *state_of_estimator) const
  {
    of.settle(state, place, current, integral, hovers, state_of_estimator);
  }
  Estimator *estimator;
  Control *control;
  LoopOf of;
  amb_loop_input in{};
  // An optional array of the run, a row per sample; it is kept alive.
  const amb_real *series(nb::handle values, size_t n, size_t columns, const char *name);

private:
  void set_model(Model *model);
  void set_own(const nb::object &own_controller, const nb::object &own_plant);
  nb::object keeps[2];
  Vector place, current, integral;
  bool hovers;
  std::list<Samples> kept;
  std::optional<Faults> faults;
  std::optional<OwnOf> controller, plant;
#if defined(AMB_MODEL_LOOPS)
  // An estimator, and its model for variable speed.
  struct Turning {
    Estimator *estimator;
    Model *model;
    static void turn(void *self, amb_real before, amb_real after)
    {
      const auto &both = *static_cast<Turning *>(self);
      both.estimator->turn(*both.model, before, after);
    }
    static amb_real turn_by(void *self, void *state, const amb_real rotation[])
    {
      const auto &both = *static_cast<Turning *>(self);
      return both.estimator->turn_by(*both.model, state, rotation);
    }
  } turning{};
#endif
};
