#pragma once

#include "magnets.h"

extern "C" {
#include "ambkit/kalman_run.h"
}

// Where a filter writes its history: arrays for n samples, in one block of memory. One block,
// because the allocator gives a block that was freed as a whole back at the next run, while many
// large ones would be fetched from the system page by page, which costs as much as the filter.
class History
{
public:
  History(size_t n, bool with_covariance)
  {
    const size_t triangle = with_covariance ? AMB_AXIAL_TRIANGLE : 0;
    const size_t reals = n * (AMB_AXIAL_STATES + triangle + 4);
    amb_real *next = new amb_real[reals + n / sizeof(amb_real) + 1];
    owner = nb::capsule(next, [](void *p) noexcept { delete[] static_cast<amb_real *>(p); });
    to.mean = place("mean", next, {n, AMB_AXIAL_STATES});
    to.cov = with_covariance ? place("covariance", next, {n, AMB_AXIAL_TRIANGLE}) : nullptr;
    to.innovation = place("innovation", next, {n});
    to.variance = place("variance", next, {n});
    to.k_i = place("k_i", next, {n});
    to.k_s = place("k_s", next, {n});
    to.status = reinterpret_cast<unsigned char *>(next);
    arrays["status"] = Out<unsigned char>(to.status, {n}, owner);
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

// A filter, its state, the magnet it asks, and what its last step said.
struct Kalman {
  amb_kalman kf{};
  amb_kalman_state state{};
  amb_kalman_result result{};
  nb::object keeps; // the magnet's owner
  amb_magnet magnet;
};
