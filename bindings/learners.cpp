// Online identification of the magnet constant: ADALINE and least squares.
#include "arrays.h"

extern "C" {
#include "ambkit/magnet_rls.h"
}

namespace
{

struct Adaline {
  amb_adaline element{};
  amb_adaline_state state{};
  amb_status step(amb_real y, amb_real u, amb_real f_d)
  {
    return amb_adaline_step(&element, &state, y, u, f_d);
  }
};

struct MagnetRls {
  amb_magnet_rls element{};
  amb_magnet_rls_state state{};
  amb_status step(amb_real y, amb_real u, amb_real f_d)
  {
    return amb_magnet_rls_step(&element, &state, y, u, f_d);
  }
};

// State of a learner, by name.
template <typename Learner> struct Shown {
  const char *name;
  amb_real (*value)(const Learner &);
};

constexpr Shown<Adaline> of_adaline[] = {
    {"force", [](const Adaline &a) { return a.state.force; }},
    {"k", [](const Adaline &a) { return a.state.k; }},
    {"excitation", [](const Adaline &a) { return a.state.excitation; }},
};

constexpr Shown<MagnetRls> of_rls[] = {
    {"force", [](const MagnetRls &a) { return a.state.front.force; }},
    {"k", [](const MagnetRls &a) { return a.state.k; }},
    {"load", [](const MagnetRls &a) { return a.state.load; }},
    {"excitation", [](const MagnetRls &a) { return a.state.excitation; }},
};

// Plant and learning rates.
amb_adaline front_of(amb_real s0, amb_real i0, bool two_sided, amb_real T, amb_real m,
                     amb_real K_sen, amb_real a_sen, amb_real k_ui, amb_real iu_min,
                     amb_real iu_max, amb_real f_0, amb_real bandwidth, amb_real rate_force,
                     amb_real rate_k, amb_real least_excitation)
{
  const amb_law law{0, s0, i0, two_sided, 1, 1};
  return {law, T,         m,          K_sen,  a_sen,           k_ui, iu_min, iu_max,
          f_0, bandwidth, rate_force, rate_k, least_excitation};
}

void init_adaline(Adaline *self, amb_real s0, amb_real i0, bool two_sided, amb_real T, amb_real m,
                  amb_real K_sen, amb_real a_sen, amb_real k_ui, amb_real iu_min, amb_real iu_max,
                  amb_real f_0, amb_real bandwidth, amb_real rate_force, amb_real rate_k,
                  amb_real least_excitation, amb_real k)
{
  new (self) Adaline{};
  self->element = front_of(s0, i0, two_sided, T, m, K_sen, a_sen, k_ui, iu_min, iu_max, f_0,
                           bandwidth, rate_force, rate_k, least_excitation);
  amb_adaline_reset(&self->state, k);
}

void init_rls(MagnetRls *self, amb_real s0, amb_real i0, bool two_sided, amb_real T, amb_real m,
              amb_real K_sen, amb_real a_sen, amb_real k_ui, amb_real iu_min, amb_real iu_max,
              amb_real f_0, amb_real bandwidth, amb_real rate_force, amb_real forgetting,
              amb_real least_excitation, unsigned settling, bool with_load, amb_real k)
{
  new (self) MagnetRls{};
  const amb_adaline front = front_of(s0, i0, two_sided, T, m, K_sen, a_sen, k_ui, iu_min, iu_max,
                                     f_0, bandwidth, rate_force, 1 - forgetting, least_excitation);
  self->element = {front, forgetting, least_excitation, settling, with_load};
  if (amb_magnet_rls_reset(&self->element, &self->state, k) != AMB_OK)
    throw std::invalid_argument("recursive least squares: bad forgetting, excitation or start");
}

template <typename Learner, size_t N>
Named run(Learner &self, const Shown<Learner> (&shown)[N], const Vector &y, const Vector &u,
          const Vector &f_d)
{
  const size_t n = y.size();
  same_length(n, u.size(), "u");
  same_length(n, f_d.size(), "f_d");
  std::vector<Fresh<amb_real>> columns;
  for (size_t c = 0; c < N; c++)
    columns.emplace_back(std::initializer_list<size_t>{n});
  Fresh<unsigned char> status({n});
  {
    nb::gil_scoped_release release;
    for (size_t i = 0; i < n; i++) {
      const size_t acted = i > 0 ? i - 1 : 0;
      const amb_status s = self.step(y.data()[i], u.data()[acted], f_d.data()[acted]);
      for (size_t c = 0; c < N; c++)
        columns[c].data[i] = shown[c].value(self);
      status.data[i] = static_cast<unsigned char>(s);
    }
  }
  nb::dict out;
  for (size_t c = 0; c < N; c++)
    out[shown[c].name] = columns[c].array;
  out["status"] = status.array;
  return out;
}

template <typename Learner, size_t N>
void bind(nb::class_<Learner> &learner, const Shown<Learner> (&shown)[N])
{
  learner.def("step", &Learner::step, nb::arg("y"), nb::arg("u"), nb::arg("f_d") = 0)
      .def(
          "run",
          [&shown](Learner &self, const Vector &y, const Vector &u, const Vector &f_d) {
            return run(self, shown, y, u, f_d);
          },
          nb::arg("y"), nb::arg("u"), nb::arg("f_d"),
          "A whole record; u[k] and f_d[k] act from sample k to k + 1.");
  learner.def_prop_rw(
      "state", [](const Learner &self) { return kept({{&self.state, sizeof self.state}}); },
      [](Learner &self, const nb::bytes &from) {
        restore(from, {{&self.state, sizeof self.state}});
      },
      "All that it has learned, as bytes of this build, for a learner that was made alike.");
  for (const Shown<Learner> &entry : shown)
    learner.def_prop_ro(entry.name, entry.value);
}

} // namespace

void bind_learners(nb::module_ &m)
{
  nb::class_<Adaline> adaline(m, "Adaline",
                              "Force and magnet constant from the motion (eq. 22-25).");
  adaline.def("__init__", &init_adaline, nb::kw_only(), nb::arg("s0"), nb::arg("i0"),
              nb::arg("two_sided"), nb::arg("T"), nb::arg("m"), nb::arg("K_sen"), nb::arg("a_sen"),
              nb::arg("k_ui"), nb::arg("iu_min"), nb::arg("iu_max"), nb::arg("f_0"),
              nb::arg("bandwidth"), nb::arg("rate_force"), nb::arg("rate_k"),
              nb::arg("least_excitation"), nb::arg("k"));
  bind(adaline, of_adaline);
  nb::class_<MagnetRls> rls(m, "MagnetRls",
                            "Magnet constant by least squares, load unknown or known.");
  rls.def("__init__", &init_rls, nb::kw_only(), nb::arg("s0"), nb::arg("i0"), nb::arg("two_sided"),
          nb::arg("T"), nb::arg("m"), nb::arg("K_sen"), nb::arg("a_sen"), nb::arg("k_ui"),
          nb::arg("iu_min"), nb::arg("iu_max"), nb::arg("f_0"), nb::arg("bandwidth"),
          nb::arg("rate_force"), nb::arg("forgetting"), nb::arg("least_excitation"),
          nb::arg("settling"), nb::arg("with_load"), nb::arg("k"));
  bind(rls, of_rls);
}
