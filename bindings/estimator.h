// What every estimator of the family is to Python: its parameters, its magnet, its state.
#pragma once

#include "magnets.h"

#include <cstddef>

extern "C" {
#include "ambkit/estimator_run.h"
}

// Where a filter writes its history: arrays for n samples, in one block of memory. One block,
// because the allocator gives a block that was freed as a whole back at the next run, while many
// large ones would be fetched from the system page by page, which costs as much as the filter.
class History
{
public:
  History(size_t n, bool with_covariance, bool with_scale)
  {
    const size_t columns =
        AMB_AXIAL_STATES + 4 + (with_covariance ? AMB_AXIAL_TRIANGLE : 0) + (with_scale ? 2 : 0);
    amb_real *next = new amb_real[n * columns + n / 2 + 1]; // a status is at most half a real
    owner = nb::capsule(next, [](void *p) noexcept { delete[] static_cast<amb_real *>(p); });
    to.mean = place("mean", next, {n, AMB_AXIAL_STATES});
    to.cov = with_covariance ? place("covariance", next, {n, AMB_AXIAL_TRIANGLE}) : nullptr;
    to.innovation = place("innovation", next, {n});
    to.variance = place("variance", next, {n});
    to.k_i = place("k_i", next, {n});
    to.k_s = place("k_s", next, {n});
    to.scale = with_scale ? place("scale", next, {n}) : nullptr;
    to.scale_variance = with_scale ? place("scale_variance", next, {n}) : nullptr;
    to.status = reinterpret_cast<unsigned short *>(next);
    arrays["status"] = Out<unsigned short>(to.status, {n}, owner);
  }
  amb_kalman_history to{};
  nb::dict arrays;

private:
  nb::capsule owner;
  amb_real *place(const char *name, amb_real *&next, std::initializer_list<size_t> shape)
  {
    amb_real *data = next;
    size_t size = 1;
    for (size_t extent : shape)
      size *= extent;
    next += size;
    arrays[name] = Out<amb_real>(data, shape, owner);
    return data;
  }
};

// An estimator, its state, the magnet it asks, and what its last step said. Each kind is a class
// of its own, which adds what only it has (`own`) and how that is shown (`more`).
struct Estimator {
  amb_kalman kf{};
  amb_magnet magnet{};
  amb_estimator estimator;
  amb_kalman_result result{};

  Estimator(const amb_estimator_methods &methods, nb::object asked, const nb::kwargs &settings);
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
  void copy_state(const Estimator &other) // of a kind that keeps the same
  {
    memory = other.memory;
    result = other.result;
  }
  bool scales() const
  {
    return estimator.methods->scale != nullptr;
  }
  virtual nb::dict more() const // the fields of `own`, by their names
  {
    return {};
  }

private:
  nb::object keeps; // the magnet's owner, or the estimator inside
  std::vector<std::max_align_t> memory;
};

// A whole record; the history is made here.
Named run_input(Estimator &self, const amb_kalman_input &input, bool covariance);
