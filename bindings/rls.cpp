#include "arrays.h"

extern "C" {
#include "ambkit/magnet_rls.h"
}

namespace
{

struct Rls {
  amb_rls rls{};
  amb_rls_state state{};
};

void init_rls(Rls *self, const Vector &theta, const Vector &known, amb_real forgetting,
              amb_real least_excitation)
{
  same_length(theta.size(), known.size(), "known");
  new (self) Rls{};
  self->rls = {theta.size(), forgetting, least_excitation};
  if (amb_rls_reset(&self->rls, &self->state, theta.data(), known.data()) != AMB_OK)
    throw std::invalid_argument("recursive least squares: bad size, forgetting or start");
}

Named run_rls(Rls &self, const Matrix &phi, const Vector &y)
{
  const size_t samples = y.size(), n = self.rls.n;
  same_length(samples, phi.shape(0), "phi");
  same_length(n, phi.shape(1), "each row of phi");
  Fresh<amb_real> theta({samples, n}), excitation({samples, n}), error({samples});
  Fresh<unsigned char> status({samples});
  {
    nb::gil_scoped_release release;
    for (size_t i = 0; i < samples; i++) {
      const amb_status s = amb_rls_step(&self.rls, &self.state, phi.data() + i * n, y.data()[i]);
      std::copy_n(self.state.theta, n, theta.data + i * n);
      std::copy_n(self.state.excitation, n, excitation.data + i * n);
      error.data[i] = self.state.error;
      status.data[i] = static_cast<unsigned char>(s);
    }
  }
  nb::dict out;
  out["theta"] = theta.array;
  out["excitation"] = excitation.array;
  out["error"] = error.array;
  out["status"] = status.array;
  return out;
}

struct MagnetRls {
  amb_magnet_rls element{};
  amb_magnet_rls_state state{};
};

void init_magnet(MagnetRls *self, amb_real s0, amb_real i0, bool two_sided, amb_real T, amb_real m,
                 amb_real K_sen, amb_real a_sen, amb_real k_ui, amb_real iu_min, amb_real iu_max,
                 amb_real f_0, amb_real bandwidth, amb_real rate_force, amb_real forgetting,
                 amb_real least_excitation, unsigned settling, bool with_load, amb_real k)
{
  new (self) MagnetRls{};
  const amb_law law{0, s0, i0, two_sided, 1, 1};
  const amb_adaline front{
      law, T,         m,          K_sen,          a_sen,           k_ui, iu_min, iu_max,
      f_0, bandwidth, rate_force, 1 - forgetting, least_excitation};
  self->element = {front, forgetting, least_excitation, settling, with_load};
  if (amb_magnet_rls_reset(&self->element, &self->state, k) != AMB_OK)
    throw std::invalid_argument("recursive least squares: bad forgetting, excitation or start");
}

Named run_magnet(MagnetRls &self, const Vector &y, const Vector &u, const Vector &f_d)
{
  const size_t n = y.size();
  same_length(n, u.size(), "u");
  same_length(n, f_d.size(), "f_d");
  Fresh<amb_real> force({n}), k({n}), load({n}), excitation({n});
  Fresh<unsigned char> status({n});
  {
    nb::gil_scoped_release release;
    for (size_t i = 0; i < n; i++) {
      const size_t acted = i > 0 ? i - 1 : 0;
      const amb_status s = amb_magnet_rls_step(&self.element, &self.state, y.data()[i],
                                               u.data()[acted], f_d.data()[acted]);
      force.data[i] = self.state.front.force;
      k.data[i] = self.state.k;
      load.data[i] = self.state.load;
      excitation.data[i] = self.state.excitation;
      status.data[i] = static_cast<unsigned char>(s);
    }
  }
  nb::dict out;
  out["force"] = force.array;
  out["k"] = k.array;
  out["load"] = load.array;
  out["excitation"] = excitation.array;
  out["status"] = status.array;
  return out;
}

} // namespace

void bind_rls(nb::module_ &m)
{
  nb::class_<Rls>(m, "Rls", "Recursive least squares with forgetting.")
      .def("__init__", &init_rls, nb::arg("theta"), nb::arg("known"), nb::kw_only(),
           nb::arg("forgetting"), nb::arg("least_excitation"))
      .def("run", &run_rls, nb::arg("phi"), nb::arg("y"),
           "Regressors (samples, n) and outputs (samples); theta and excitation after each.");
  nb::class_<MagnetRls>(m, "MagnetRls", "Magnet constant by least squares, load unknown or known.")
      .def("__init__", &init_magnet, nb::kw_only(), nb::arg("s0"), nb::arg("i0"),
           nb::arg("two_sided"), nb::arg("T"), nb::arg("m"), nb::arg("K_sen"), nb::arg("a_sen"),
           nb::arg("k_ui"), nb::arg("iu_min"), nb::arg("iu_max"), nb::arg("f_0"),
           nb::arg("bandwidth"), nb::arg("rate_force"), nb::arg("forgetting"),
           nb::arg("least_excitation"), nb::arg("settling"), nb::arg("with_load"), nb::arg("k"))
      .def(
          "step",
          [](MagnetRls &self, amb_real y, amb_real u, amb_real f_d) {
            return amb_magnet_rls_step(&self.element, &self.state, y, u, f_d);
          },
          nb::arg("y"), nb::arg("u"), nb::arg("f_d") = 0)
      .def("run", &run_magnet, nb::arg("y"), nb::arg("u"), nb::arg("f_d"),
           "A whole record; u[k] and f_d[k] act from sample k to k + 1.")
      .def_prop_ro("force", [](const MagnetRls &a) { return a.state.front.force; })
      .def_prop_ro("k", [](const MagnetRls &a) { return a.state.k; })
      .def_prop_ro("load", [](const MagnetRls &a) { return a.state.load; })
      .def_prop_ro("excitation", [](const MagnetRls &a) { return a.state.excitation; });
}
