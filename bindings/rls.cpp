#include "arrays.h"

extern "C" {
#include "ambkit/rls.h"
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
  Results out;
  auto *theta = out.add<amb_real>("theta", {samples, n});
  auto *excitation = out.add<amb_real>("excitation", {samples, n});
  auto *error = out.add<amb_real>("error", {samples});
  auto *status = out.add<unsigned char>("status", {samples});
  {
    nb::gil_scoped_release release;
    for (size_t i = 0; i < samples; i++) {
      const amb_status s = amb_rls_step(&self.rls, &self.state, phi.data() + i * n, y.data()[i]);
      std::copy_n(self.state.theta, n, theta + i * n);
      std::copy_n(self.state.excitation, n, excitation + i * n);
      error[i] = self.state.error;
      status[i] = static_cast<unsigned char>(s);
    }
  }
  return out.named();
}

} // namespace

void bind_rls(nb::module_ &m)
{
  nb::class_<Rls>(m, "Rls", "Recursive least squares with forgetting.")
      .def("__init__", &init_rls, nb::arg("theta"), nb::arg("known"), nb::kw_only(),
           nb::arg("forgetting"), nb::arg("least_excitation"))
      .def("run", &run_rls, nb::arg("phi"), nb::arg("y"),
           "Regressors (samples, n) and outputs (samples); theta and excitation after each.");
}
