// Estimators in Python: parameters, magnets, state.
#pragma once

#include "magnets.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <initializer_list>
#include <memory>
#include <vector>

extern "C" {
#include "ambkit/estimator_run.h"
#if defined(AMB_MODEL_LOOPS)
#include "ambkit/turning.h"
#endif
}

// Information on the rotation at a sample: the fields of amb_rotation, and the speed there.
constexpr size_t ROTATION_FIELDS = 11;

// The model of a machine (ambkit/model.h); in the build for any model with its arrays.
struct Model {
  amb_model model{};
  Model() = default;
  Model(const Model &) = delete; // pointers of `model` point into the object
#if defined(AMB_MODEL_LOOPS)
  explicit Model(const nb::dict &arrays);

  // Its numbers that depend on the speed, at nodes (ambkit/turning.h); required for variable speed.
  void nodes(int lowest, amb_real step, const Vector &still, const Places &which, const Matrix &at,
             const Places &grown, const Matrix &by_growth);
  void turn(amb_real speed, amb_real growth);
  void stand(const Vector &still);
  // The states that rotate with the rotor, and the error of its speed (ambkit/turning.h).
  void synchronous(const nb::dict &arguments);
  amb_real by(amb_kalman &kf, amb_kalman_state &state, const amb_real rotation[]);
  bool turns() const
  {
    return turning.nodes > 0;
  }

private:
  amb_turning turning{};
  amb_speed_error error{-1, 0, 0, nullptr, nullptr, false};
  amb_direction direction{};
  std::vector<amb_synchronous> pairs;
  std::vector<amb_real> starts;
  std::vector<unsigned short> kept_which, kept_grown;
  std::vector<amb_real> kept_at, kept_by_growth;
  std::vector<std::vector<unsigned short>> places;
  std::vector<std::vector<amb_real>> loose; // until they are gathered
  std::vector<amb_real> numbers;            // L, b, B_u, h, e, r, d, c, N, rest
  std::vector<unsigned char> roles;
  amb_sparse sparse(const nb::dict &arrays, const char *name, size_t rows, size_t columns);
  void values(const nb::dict &arrays, const char *name, size_t count);
  void gather();
#else
  Model(amb_real T, amb_real m, amb_real K_sen, amb_real T_sen, bool as_printed);
#endif
};

// The numbers of a built-in model, by name.
nb::dict shown(const amb_model &model);

// Sizes of a model.
struct Sizes {
  size_t states, entries, forces, controls, sensors, noises;
  explicit Sizes(const amb_model &model)
      : states(amb_states(&model)), entries(states * (states + 1) / 2), forces(amb_forces(&model)),
        controls(amb_controls(&model)), sensors(amb_sensors(&model)), noises(amb_noises(&model))
  {
  }
};

// Memory of a history. It takes megabytes, and allocating it page by page would cost a tenth of the
// filter's time or more; the last one released is reused if it fits.
struct Memory {
  size_t size;
  std::unique_ptr<amb_real[]> data;

  static Memory *of(size_t size)
  {
    if (size >= LEAST) {
      std::unique_ptr<Memory> last(spare().exchange(nullptr));
      if (last && last->size >= size && last->size / 2 <= size)
        return last.release();
    }
    return new Memory{size, std::unique_ptr<amb_real[]>(new amb_real[size])};
  }
  static void let_go(Memory *memory) noexcept
  {
    if (memory->size >= LEAST && memory->size <= MOST)
      memory = spare().exchange(memory);
    delete memory;
  }

private:
  // From 128 kB, below which the allocator keeps it anyway, to 32 MB.
  static constexpr size_t LEAST = (size_t{128} << 10) / sizeof(amb_real);
  static constexpr size_t MOST = (size_t{32} << 20) / sizeof(amb_real);
  static std::atomic<Memory *> &spare()
  {
    static std::atomic<Memory *> kept{nullptr};
    return kept;
  }
};

// Destination of a filter's history: arrays for n samples, in one block of memory.
class History
{
public:
  History(size_t n, const Sizes &of, bool with_covariance, bool with_scale)
  {
    const size_t columns = of.states + 2 * of.sensors + 2 * of.forces +
                           (with_covariance ? of.entries : 0) + (with_scale ? 2 : 0);
    const size_t flags = n * (1 + of.sensors); // a status is at most half the size of a real
    Memory *memory = Memory::of(n * columns + flags / 2 + 1);
    owner = nb::capsule(memory, [](void *p) noexcept { Memory::let_go(static_cast<Memory *>(p)); });
    amb_real *next = memory->data.get();
    to.mean = place("mean", next, n, of.states, true);
    to.cov = with_covariance ? place("covariance", next, n, of.entries, true) : nullptr;
    to.innovation = place("innovation", next, n, of.sensors, false);
    to.variance = place("variance", next, n, of.sensors, false);
    to.k_i = place("k_i", next, n, of.forces, false);
    to.k_s = place("k_s", next, n, of.forces, false);
    to.scale = with_scale ? place("scale", next, n, 1, false) : nullptr;
    to.scale_variance = with_scale ? place("scale_variance", next, n, 1, false) : nullptr;
    to.status = reinterpret_cast<unsigned short *>(next);
    to.health = of.sensors == 1 ? to.status : to.status + n;
    arrays["status"] = Out<unsigned short>(to.status, {n}, owner);
    if (of.sensors > 1)
      arrays["health"] = Out<unsigned short>(to.health, {n, of.sensors}, owner);
  }
  amb_kalman_history to{};
  nb::dict arrays;

private:
  nb::capsule owner;
  // n rows; scalars if there is a single column that is not a table.
  amb_real *place(const char *name, amb_real *&next, size_t n, size_t columns, bool table)
  {
    amb_real *data = next;
    next += n * columns;
    if (table || columns > 1)
      arrays[name] = Out<amb_real>(data, {n, columns}, owner);
    else
      arrays[name] = Out<amb_real>(data, {n}, owner);
    return data;
  }
};

// Arrays with n rows, or of n numbers: n x columns.
using Samples = nb::ndarray<const amb_real, nb::c_contig, nb::device::cpu>;

inline size_t samples_of(const Samples &a, size_t columns, const char *name)
{
  if (columns == 0 || a.size() % columns != 0 || (a.ndim() > 1 && a.shape(1) != columns))
    throw std::invalid_argument(std::string(name) + " must have " + std::to_string(columns) +
                                " columns");
  return a.size() / columns;
}

// An estimator with its state, its magnets and the result of its last step. Each kind is a derived
// class with its own data (`own`), and their presentation (`more`).
struct Estimator {
  amb_kalman kf{};
  std::vector<amb_magnet> magnets;
  amb_estimator estimator{};
  amb_kalman_result result{};

  Estimator(const amb_estimator_methods &methods, nb::object magnet, nb::object of,
            const nb::kwargs &settings);
  Estimator(const amb_estimator_methods &methods, nb::object around); // another one
  virtual ~Estimator() = default;
  Estimator(const Estimator &) = delete; // `estimator` points into the object

  void *state()
  {
    return memory.data();
  }
  const amb_kalman_state &base() const
  {
    return *reinterpret_cast<const amb_kalman_state *>(memory.data());
  }
  void copy_state(const Estimator &other) // of the same kind
  {
    memory = other.memory;
    result = other.result;
  }
  Sizes sizes() const
  {
    return Sizes(kf.model);
  }
  bool scales() const
  {
    return estimator.methods->scale != nullptr;
  }
#if defined(AMB_MODEL_LOOPS)
  // Update the model for a change between two speeds [rad/s].
  void turn(Model &model, amb_real before, amb_real after)
  {
    model.turn((before + after) / 2, (after - before) / kf.set.T);
    amb_model_growth(&kf.model, kf.set.var_d, kf.growth);
  }
  // The same from the information on the rotation within a sample: ROTATION_FIELDS numbers.
  amb_real turn_by(Model &model, void *of, const amb_real rotation[])
  {
    if (usual.empty())
      usual.assign(kf.set.var_d, kf.set.var_d + sizes().noises);
    return model.by(kf, *static_cast<amb_kalman_state *>(of), rotation);
  }
  // The same for sample k of a record: speeds (n,) [rad/s], or information (n, ROTATION_FIELDS).
  // Returns whether the rotor is found to spin against that information.
  bool turn_at(Model &model, const amb_real *speed, size_t k, bool measured)
  {
    if (k > 0 && measured) {
      const amb_real *now = speed + k * ROTATION_FIELDS;
      return turn_by(model, state(), now) * now[ROTATION_FIELDS - 1] < 0;
    }
    if (k > 0)
      turn(model, speed[k - 1], speed[k]);
    return false;
  }
  // Restore the model for its original speed, with the same bits.
  void stand(Model &model, const Vector &still)
  {
    model.stand(still);
    std::copy(usual.begin(), usual.end(), kf.set.var_d);
    usual.clear();
    amb_model_growth(&kf.model, kf.set.var_d, kf.growth);
  }
#endif
  virtual nb::dict more() const // the fields of `own`, by name
  {
    return {};
  }

  // Check that the model has the states that a kind or function needs.
  void must_have(std::initializer_list<amb_role> roles, const char *who) const;
  // Check that there is one sensor and one control.
  void must_be_single(const char *who) const;

private:
#if defined(AMB_MODEL_LOOPS)
  // var_d of the settings, while the angle's error changes some of them
  std::vector<amb_real> usual;
#endif
  nb::object keeps, keeps_too; // owners of the magnets, and of the model or inner estimator
  std::vector<std::max_align_t> memory;
};

// Fill an array of a struct of the core; all values must be given.
inline void fill(amb_real *to, const Vector &from, size_t n, const char *name)
{
  same_length(n, from.size(), name);
  std::copy_n(from.data(), n, to);
}

// A complete record, with these instructions or the widest; the history is created here.
Named run_input(Estimator &self, const amb_kalman_input &input, bool covariance,
                const std::optional<std::string> &instructions);

// The same; `on` (n,): 0 while the magnets have no current, else 1.
Named run_supplied(Estimator &self, const Samples &y, const Samples &u, bool covariance,
                   const std::optional<std::string> &instructions,
                   const std::optional<Samples> &on);

// In estimator_runs.cpp: steps and runs of the class, and runs with variable speed.
void bind_steps(nb::class_<Estimator> &estimator);
#if defined(AMB_MODEL_LOOPS)
void bind_turning(nb::module_ &m);
#endif
