#include "arrays.h"

extern "C" {
#include "ambkit/adaline.h"
}

namespace
{

struct Adaline {
  amb_adaline element{};
  amb_adaline_state state{};
};

void init(Adaline *self, amb_real s0, amb_real i0, bool two_sided, amb_real T, amb_real m,
          amb_real K_sen, amb_real a_sen, amb_real k_ui, amb_real iu_min, amb_real iu_max,
          amb_real f_0, amb_real bandwidth, amb_real rate_force, amb_real rate_k,
          amb_real least_excitation, amb_real k)
{
  new (self) Adaline{};
  const amb_law law{0, s0, i0, two_sided, 1, 1};
  self->element = {law, T,         m,          K_sen,  a_sen,           k_ui, iu_min, iu_max,
                   f_0, bandwidth, rate_force, rate_k, least_excitation};
  amb_adaline_reset(&self->state, k);
}

Named run(Adaline &self, const Vector &y, const Vector &u, const Vector &f_d)
{
  const size_t n = y.size();
  same_length(n, u.size(), "u");
  same_length(n, f_d.size(), "f_d");
  Fresh<amb_real> force({n}), k({n}), excitation({n});
  Fresh<unsigned char> status({n});
  {
    nb::gil_scoped_release release;
    for (size_t i = 0; i < n; i++) {
      const size_t acted = i > 0 ? i - 1 : 0;
      const amb_status s = amb_adaline_step(&self.element, &self.state, y.data()[i],
                                            u.data()[acted], f_d.data()[acted]);
      force.data[i] = self.state.force;
      k.data[i] = self.state.k;
      excitation.data[i] = self.state.excitation;
      status.data[i] = static_cast<unsigned char>(s);
    }
  }
  nb::dict out;
  out["force"] = force.array;
  out["k"] = k.array;
  out["excitation"] = excitation.array;
  out["status"] = status.array;
  return out;
}

} // namespace

void bind_adaline(nb::module_ &m)
{
  nb::class_<Adaline>(m, "Adaline", "Force and magnet constant from the motion (eq. 22-25).")
      .def("__init__", &init, nb::kw_only(), nb::arg("s0"), nb::arg("i0"), nb::arg("two_sided"),
           nb::arg("T"), nb::arg("m"), nb::arg("K_sen"), nb::arg("a_sen"), nb::arg("k_ui"),
           nb::arg("iu_min"), nb::arg("iu_max"), nb::arg("f_0"), nb::arg("bandwidth"),
           nb::arg("rate_force"), nb::arg("rate_k"), nb::arg("least_excitation"), nb::arg("k"))
      .def(
          "step",
          [](Adaline &self, amb_real y, amb_real u, amb_real f_d) {
            return amb_adaline_step(&self.element, &self.state, y, u, f_d);
          },
          nb::arg("y"), nb::arg("u"), nb::arg("f_d") = 0)
      .def("run", &run, nb::arg("y"), nb::arg("u"), nb::arg("f_d"),
           "A whole record; u[k] and f_d[k] act from sample k to k + 1.")
      .def_prop_ro("force", [](const Adaline &a) { return a.state.force; })
      .def_prop_ro("k", [](const Adaline &a) { return a.state.k; })
      .def_prop_ro("excitation", [](const Adaline &a) { return a.state.excitation; });
}
