// Construction, start and properties of the estimators.
#include "estimator.h"

extern "C" {
#include "ambkit/law_error.h"
#include "ambkit/ud.h"
#include "ambkit/unscented.h"
}

namespace
{

// The settings by name, with their numbers of values; 0: a scalar.
template <typename Settings, typename Visit>
void each_setting(Settings &s, const Sizes &of, Visit visit)
{
  visit("T", s.T, 0);
  visit("K_sen", s.K_sen, of.sensors);
  visit("lag", s.lag, of.sensors);
  visit("travel", s.travel, of.sensors);
  visit("k_ui", s.k_ui, of.controls);
  visit("iu_min", s.iu_min, of.controls);
  visit("iu_max", s.iu_max, of.controls);
  visit("f_0", s.f_0, of.forces);
  visit("x_max", s.x_max, of.forces);
  visit("cap", s.cap, of.states);
  visit("var_u", s.var_u, of.controls);
  visit("var_d", s.var_d, of.noises);
  visit("var_y", s.var_y, of.sensors);
  visit("rise", s.rise, of.sensors);
  visit("step", s.step, of.sensors);
  visit("dwell", s.dwell, 0);
  visit("gate", s.gate, 0);
  visit("frozen_limit", s.frozen_limit, 0);
  visit("outlier_limit", s.outlier_limit, 0);
}

// All must be given, and no others.
amb_kalman_settings settings_of(const nb::kwargs &settings, const Sizes &of)
{
  amb_kalman_settings s{};
  size_t known = 0;
  each_setting(s, of, [&](const char *name, auto &field, size_t count) {
    using Field = std::remove_reference_t<decltype(field)>;
    if (!settings.contains(name))
      throw std::invalid_argument(std::string("the setting ") + name + " is missing");
    if constexpr (std::is_array_v<Field>) {
      const auto values = nb::cast<std::vector<amb_real>>(settings[name]);
      same_length(count, values.size(), name);
      std::copy(values.begin(), values.end(), field);
    } else
      field = nb::cast<Field>(settings[name]);
    known++;
  });
  if (settings.size() != known)
    throw std::invalid_argument("there is a setting that no estimator has");
  return s;
}

nb::list magnets_of(nb::object magnet)
{
  if (nb::isinstance<nb::list>(magnet))
    return nb::cast<nb::list>(magnet);
  nb::list one;
  one.append(magnet);
  return one;
}

} // namespace

Estimator::Estimator(const amb_estimator_methods &methods, nb::object magnet, nb::object of,
                     const nb::kwargs &settings)
    : keeps(magnets_of(magnet)), keeps_too(of),
      memory(methods.state_size / sizeof(std::max_align_t) + 1)
{
  const amb_model &model = nb::cast<const Model &>(of).model;
  const Sizes sizes(model);
  const amb_kalman_settings s = settings_of(settings, sizes);
  if (amb_kalman_init(&kf, &model, &s) != AMB_OK)
    throw std::invalid_argument("a setting of the estimator is outside its range");
  for (nb::handle magnet : nb::cast<nb::list>(keeps))
    magnets.push_back(nb::cast<const Magnet &>(magnet).magnet);
  if (magnets.size() != sizes.forces)
    throw std::invalid_argument("there are " + std::to_string(magnets.size()) + " magnets for " +
                                std::to_string(sizes.forces) + " forces");
  estimator = {&methods, &kf, magnets.data(), nullptr};
}

Estimator::Estimator(const amb_estimator_methods &methods, nb::object around)
    : keeps(around), memory(methods.state_size / sizeof(std::max_align_t) + 1)
{
  const auto &inner = nb::cast<const Estimator &>(around);
  kf = inner.kf;
  magnets = inner.magnets;
  estimator = {&methods, &kf, magnets.data(), nullptr};
}

void Estimator::must_have(std::initializer_list<amb_role> roles, const char *who) const
{
  const auto called = [](amb_role role) {
    switch (role) {
    case AMB_POSITION:
      return "position of the rotor";
    case AMB_VELOCITY:
      return "velocity of the rotor";
    default:
      return "disturbance force";
    }
  };
  for (const amb_role role : roles)
    if (amb_first(&kf.model, role) < 0)
      throw std::invalid_argument(std::string(who) + " needs a " + called(role) +
                                  " among the states of the model, which has none");
}

void Estimator::must_be_single(const char *who) const
{
  const Sizes of = sizes();
  if (of.sensors != 1 || of.controls != 1)
    throw std::invalid_argument(std::string(who) +
                                " takes one sensor and one control; the model "
                                "has " +
                                std::to_string(of.sensors) + " and " + std::to_string(of.controls));
}

namespace
{

void reset(Estimator &self, const Vector &mean, std::optional<Vector> std)
{
  same_length(self.sizes().states, mean.size(), "mean");
  if (std)
    same_length(self.sizes().states, std->size(), "std");
  if (self.estimator.methods->reset(&self.estimator, self.state(), mean.data(),
                                    std ? std->data() : nullptr) != AMB_OK)
    throw std::invalid_argument("mean must be finite, std finite and positive");
  self.result = amb_kalman_result{};
}

// Whether the state of a kind does not depend on its parameters: mean, covariance and counters
// only.
bool keeps_estimates_only(const Estimator &one)
{
  const amb_estimator_methods *kinds[] = {&amb_kalman_methods, &amb_extended_methods,
                                          &amb_unscented_methods};
  return std::find(std::begin(kinds), std::end(kinds), one.estimator.methods) != std::end(kinds);
}

void transfer_from(Estimator &self, const Estimator &other)
{
  const auto *kind = self.estimator.methods;
  const bool factors = kind == &amb_ud_methods && kind == other.estimator.methods;
  if (!factors && !(keeps_estimates_only(self) && keeps_estimates_only(other)))
    throw std::invalid_argument("only linear, adaptive, extended and unscented Kalman filters can "
                                "take over from each other, and the UD-factorised one from its own "
                                "kind");
  same_length(self.sizes().states, other.sizes().states, "the other filter");
  self.copy_state(other);
}

Out<amb_real> mean(const Estimator &self)
{
  const size_t n = self.sizes().states;
  Fresh<amb_real> a({n});
  std::copy_n(self.base().mean, n, a.data);
  return a.array;
}

// The memory of the state, so that a caller can step without creating arrays.
nb::ndarray<nb::numpy, const amb_real> live(nb::handle_t<Estimator> self)
{
  const auto &estimator = nb::cast<Estimator &>(self);
  return nb::ndarray<nb::numpy, const amb_real>(estimator.base().mean, {estimator.sizes().states},
                                                self);
}

Out<amb_real> covariance(const Estimator &self)
{
  const size_t n = self.sizes().states;
  Fresh<amb_real> P({n, n});
  const int rows = static_cast<int>(n);
  amb_unfold(rows, self.base().cov, rows, P.data);
  return P.array;
}

// Along n samples with the control signals (n, controls) that acted last; one that is not finite is
// replaced by the last finite one. Without an initial bias the first is the equilibrium one; all
// are, if the bias is not carried from one sample to the next.
Out<amb_real> law_bias(const Estimator &self, const Vector &law, const Vector &gain,
                       const Samples &mean, const Samples &covariance, const Samples &u,
                       const nb::ndarray<const bool, nb::ndim<2>, nb::c_contig> &used,
                       const std::optional<Vector> &before, bool carried)
{
  const Sizes of = self.sizes();
  const size_t n = used.shape(0);
  same_length(of.forces * AMB_LAW_TERMS, law.size(), "law");
  same_length(of.sensors, used.shape(1), "used");
  same_length(n, samples_of(mean, of.states, "mean"), "used");
  same_length(n, samples_of(covariance, of.entries, "covariance"), "used");
  same_length(n, samples_of(u, of.controls, "u"), "used");
  if (gain.size() > 0)
    same_length(of.sensors * of.states, gain.size(), "gain");
  if (before)
    same_length(of.states, before->size(), "before");
  Fresh<amb_real> rows({n, of.states});
  amb_kalman_state base{};
  amb_real bias[AMB_STATES] = {0};
  for (size_t k = 0; k < n; k++) {
    std::copy_n(mean.data() + k * of.states, of.states, base.mean);
    std::copy_n(covariance.data() + k * of.entries, of.entries, base.cov);
    for (size_t c = 0; c < of.controls; c++) {
      const amb_real now = u.data()[k * of.controls + c];
      base.last_u[c] = amb_is_finite(now) ? now : base.last_u[c];
    }
    if (k == 0 && before)
      std::copy_n(before->data(), of.states, bias);
    if (carried && (k > 0 || before))
      amb_law_step(&self.kf, self.magnets.data(), law.data(),
                   gain.size() > 0 ? gain.data() : nullptr, &base, used.data() + k * of.sensors,
                   bias);
    else
      amb_law_rest(&self.kf, law.data(), &base, bias);
    std::copy_n(bias, of.states, rows.data + k * of.states);
  }
  return rows.array;
}

// Last finite control signals (controls,).
Out<amb_real> last_u(const Estimator &self)
{
  const size_t n = self.sizes().controls;
  Fresh<amb_real> u({n});
  std::copy_n(self.base().last_u, n, u.data);
  return u.array;
}

nb::object scale(Estimator &self)
{
  if (!self.scales())
    return nb::none();
  amb_real value = 0, variance = 0;
  self.estimator.methods->scale(&self.estimator, self.state(), &value, &variance);
  return nb::make_tuple(value, variance);
}

Out<amb_real> numbers(const amb_real *from, size_t n)
{
  Fresh<amb_real> copy({n});
  std::copy_n(from, n, copy.data);
  return copy.array;
}

Named parameters(const Estimator &self)
{
  const Sizes of = self.sizes();
  nb::dict set, all;
  each_setting(self.kf.set, of, [&](const char *name, const auto &field, size_t count) {
    if constexpr (std::is_array_v<std::remove_reference_t<decltype(field)>>)
      set[name] = numbers(field, count);
    else
      set[name] = field;
  });
  all["set"] = set;
  all["model"] = shown(self.kf.model);
  all["growth"] = numbers(self.kf.growth, of.entries);
  all["far"] = numbers(self.kf.far, of.sensors);
  all["rounding"] = numbers(self.kf.rounding, of.sensors);
  all["gate_squared"] = self.kf.gate_squared;
  all["widest"] = numbers(self.kf.widest, of.states);
  all["most"] = numbers(self.kf.most, of.entries);
  return all;
}

// A value per sensor or force; a scalar if there is only one.
nb::object scalar_or_array(const amb_real *from, size_t n)
{
  return n == 1 ? nb::cast(*from) : nb::cast(numbers(from, n));
}

nb::object stiffness(const Estimator &self, amb_real amb_stiffness::*which)
{
  const size_t n = self.sizes().forces;
  std::vector<amb_real> all(n);
  for (size_t f = 0; f < n; f++)
    all[f] = self.result.stiffness[f].*which;
  return scalar_or_array(all.data(), n);
}

nb::typed<nb::list, int> health(const Estimator &self)
{
  nb::typed<nb::list, int> all;
  for (size_t r = 0; r < self.sizes().sensors; r++)
    all.append(self.result.health[r]);
  return all;
}

void bind_flags(nb::module_ &m)
{
  m.attr("OK") = AMB_OK;
  m.attr("MISSING") = AMB_MISSING;
  m.attr("FROZEN") = AMB_FROZEN;
  m.attr("SATURATED") = AMB_SATURATED;
  m.attr("BAD_CONTROL") = AMB_BAD_CONTROL;
  m.attr("BAD_VARIANCE") = AMB_BAD_VARIANCE;
  m.attr("HELD") = AMB_HELD;
  m.attr("BAD_PARAMETER") = AMB_BAD_PARAMETER;
  m.attr("UNEXCITED") = AMB_UNEXCITED;
  m.attr("OUTLIER") = AMB_OUTLIER;
  m.attr("INCONSISTENT") = AMB_INCONSISTENT;
  m.attr("NOISE_LIMIT") = AMB_NOISE_LIMIT;
  m.attr("RESTARTED") = AMB_RESTARTED;
  m.attr("CONTACT") = AMB_CONTACT;
  m.attr("MIRRORED") = AMB_MIRRORED;
  m.attr("OUTSIDE") = AMB_OUTSIDE;
}

} // namespace

void bind_estimator(nb::module_ &m)
{
  bind_flags(m);
  nb::class_<Estimator> estimator(m, "Estimator", "One of the family (ambkit/estimator.h).");
  estimator
      .def("reset", &reset, nb::arg("mean"), nb::arg("std") = nb::none(),
           "Start from a mean (4,) and standard deviations (4,), uncorrelated; None: diffuse.")
      .def("transfer_from", &transfer_from, nb::arg("other"),
           "Go on where another is: its mean, covariance and counts.");
  bind_steps(estimator);
  estimator.def_prop_ro("mean", &mean, nb::rv_policy::move, "State estimate (states,).")
      .def_prop_ro("live_mean", &live, "The same, read only, which follows the estimator.")
      .def_prop_ro("covariance", &covariance, nb::rv_policy::move,
                   "Its covariance (states, states).")
      .def("law_bias", &law_bias, nb::arg("law"), nb::arg("gain"), nb::arg("mean"),
           nb::arg("covariance"), nb::arg("u"), nb::arg("used"), nb::arg("before") = nb::none(),
           nb::arg("carried") = true,
           "The bias (n, states) by its law's error along n samples, see ambkit/law_error.h.")
      .def_prop_ro("last_u", &last_u, nb::rv_policy::move, "Last control signals (controls,).")
      .def_prop_ro("scale", &scale,
                   "Scale of the magnet's force and its variance; None where not estimated.")
      .def_prop_ro("parameters", &parameters,
                   "Settings, and what was computed from them, by the names of their fields.")
      .def_prop_ro(
          "own", [](const Estimator &s) -> Named { return s.more(); },
          "What only this kind has, by the names of the fields.")
      .def_prop_rw(
          "state",
          [](Estimator &s) {
            return kept(
                {{s.state(), s.estimator.methods->state_size}, {&s.result, sizeof s.result}});
          },
          [](Estimator &s, const nb::bytes &from) {
            restore(from,
                    {{s.state(), s.estimator.methods->state_size}, {&s.result, sizeof s.result}});
          },
          "All that it knows, as bytes of this build, for an estimator that was made alike.")
      .def_prop_ro("status", [](const Estimator &s) { return s.result.status; })
      .def_prop_ro("health", &health, "What there is to say of each sensor.")
      .def_prop_ro("innovation",
                   [](const Estimator &s) {
                     return scalar_or_array(s.result.innovation, s.sizes().sensors);
                   })
      .def_prop_ro(
          "variance",
          [](const Estimator &s) { return scalar_or_array(s.result.variance, s.sizes().sensors); })
      .def_prop_ro("k_i", [](const Estimator &s) { return stiffness(s, &amb_stiffness::k_i); })
      .def_prop_ro("k_s", [](const Estimator &s) { return stiffness(s, &amb_stiffness::k_s); });
#if defined(AMB_MODEL_LOOPS)
  m.def(
      "stand", [](Estimator &self, Model &model, const Vector &still) { self.stand(model, still); },
      nb::arg("estimator"), nb::arg("model"), nb::arg("still"),
      nb::sig("def stand(estimator: Estimator, model: Model, still: Any) -> None"),
      "An estimator and its model as they were before they turned.");
  bind_turning(m);
#endif
}
