#pragma once

#include "magnets.h"

extern "C" {
#include "ambkit/kalman.h"
}

// Where a filter writes its history: new arrays for n samples.
struct History {
  Fresh<amb_real> mean, cov, innovation, variance, k_i, k_s;
  Fresh<unsigned char> status;
  bool with_covariance;
  History(size_t n, bool covariance)
      : mean({n, AMB_AXIAL_STATES}), cov({covariance ? n : 0, AMB_AXIAL_TRIANGLE}), innovation({n}),
        variance({n}), k_i({n}), k_s({n}), status({n}), with_covariance(covariance)
  {
  }
  amb_kalman_history pointers() const
  {
    return {mean.data,       with_covariance ? cov.data : nullptr,
            innovation.data, variance.data,
            k_i.data,        k_s.data,
            status.data};
  }
  void put_into(nb::dict &d) const
  {
    d["mean"] = mean.array;
    if (with_covariance)
      d["covariance"] = cov.array;
    d["innovation"] = innovation.array;
    d["variance"] = variance.array;
    d["k_i"] = k_i.array;
    d["k_s"] = k_s.array;
    d["status"] = status.array;
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
