// The estimators of the magnet's scale.
#include "estimator.h"

extern "C" {
#include "ambkit/augmented.h"
#include "ambkit/multiple_model.h"
}

namespace
{

nb::dict shown_learning(const amb_excitation_settings &learn)
{
  nb::dict d;
  d["fresh"] = learn.fresh;
  d["least"] = learn.least;
  return d;
}

amb_excitation_settings learning(amb_real fresh, amb_real least)
{
  if (!(fresh > 0 && fresh <= 1 && least >= 0))
    throw std::invalid_argument("fresh must be above 0 and at most 1, least 0 or more");
  return {fresh, least};
}

struct Augmented : Estimator {
  amb_augmented own{};
  Augmented(nb::object magnet, nb::object model, const Vector &bias, amb_real std, amb_real var_k,
            amb_real min, amb_real max, amb_real fresh, amb_real least, nb::kwargs settings)
      : Estimator(amb_augmented_methods, magnet, model, settings)
  {
    must_have({AMB_LOAD}, "estimating the magnets' scale");
    if (!(std > 0 && var_k >= 0 && min > 0 && min <= 1 && max >= 1))
      throw std::invalid_argument("std must be above 0, var_k 0 or more, 0 < min <= 1 <= max");
    fill(own.bias, bias, sizes().forces, "bias");
    own.std = std;
    own.var_k = var_k;
    own.min = min;
    own.max = max;
    own.learn = learning(fresh, least);
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    nb::dict d;
    d["bias"] = shown({own.bias, own.bias + sizes().forces}, {sizes().forces});
    d["std"] = own.std;
    d["var_k"] = own.var_k;
    d["min"] = own.min;
    d["max"] = own.max;
    d["learn"] = shown_learning(own.learn);
    return d;
  }
};

struct MultipleModel : Estimator {
  amb_multiple_model own{};
  MultipleModel(nb::object magnet, nb::object model, const Vector &theta, amb_real leave,
                const Vector &bias, amb_real fresh, amb_real least, nb::kwargs settings)
      : Estimator(amb_multiple_model_methods, magnet, model, settings)
  {
    must_have({AMB_LOAD}, "estimating the magnets' scale");
    const size_t n = theta.size();
    if (n < 2 || n > AMB_MODELS)
      throw std::invalid_argument("there must be 2 to 5 models");
    if (!(leave >= 0 && leave <= 0.5))
      throw std::invalid_argument("leave must be 0 or more and 0.5 at most");
    for (size_t i = 0; i < n; i++)
      if (!amb_is_positive(theta.data()[i]))
        throw std::invalid_argument("a scale must be positive and finite");
    own.n = static_cast<int>(n);
    std::copy_n(theta.data(), n, own.theta);
    own.leave = leave;
    fill(own.bias, bias, sizes().forces, "bias");
    own.learn = learning(fresh, least);
    estimator.own = &own;
  }
  nb::dict more() const override
  {
    const size_t n = static_cast<size_t>(own.n);
    nb::dict d;
    d["n"] = own.n;
    d["theta"] = shown({own.theta, own.theta + n}, {n});
    d["leave"] = own.leave;
    d["bias"] = shown({own.bias, own.bias + sizes().forces}, {sizes().forces});
    d["learn"] = shown_learning(own.learn);
    return d;
  }
};

Out<amb_real> weights(MultipleModel &self)
{
  const auto &state = *static_cast<const amb_multiple_model_state *>(self.state());
  const size_t n = static_cast<size_t>(self.own.n);
  Fresh<amb_real> w({n});
  for (size_t j = 0; j < n; j++)
    w.data[j] = state.model[j].weight;
  return w.array;
}

} // namespace

void bind_scale_estimators(nb::module_ &m)
{
  nb::class_<Augmented, Estimator>(m, "Augmented",
                                   "State augmented by the magnet's scale (ambkit/augmented.h).")
      .def(nb::init<nb::object, nb::object, const Vector &, amb_real, amb_real, amb_real, amb_real,
                    amb_real, amb_real, nb::kwargs>(),
           nb::arg("magnet"), nb::arg("model"), nb::arg("bias"), nb::arg("std"), nb::arg("var_k"),
           nb::arg("min"), nb::arg("max"), nb::arg("fresh"), nb::arg("least"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet | list[Magnet], model: Model, "
                   "bias: NDArray[Any], std: float, var_k: float, min: float, max: float, "
                   "fresh: float, least: float, **settings: Any) -> None"));
  nb::class_<MultipleModel, Estimator>(m, "MultipleModel",
                                       "Interacting models (ambkit/multiple_model.h).")
      .def(nb::init<nb::object, nb::object, const Vector &, amb_real, const Vector &, amb_real,
                    amb_real, nb::kwargs>(),
           nb::arg("magnet"), nb::arg("model"), nb::arg("theta"), nb::arg("leave"), nb::arg("bias"),
           nb::arg("fresh"), nb::arg("least"), nb::arg("settings"),
           nb::sig("def __init__(self, magnet: Magnet | list[Magnet], model: Model, "
                   "theta: NDArray[Any], leave: float, bias: NDArray[Any], fresh: float, "
                   "least: float, **settings: Any) -> None"))
      .def_prop_ro("weights", &weights, nb::rv_policy::move, "Probabilities of the models (n,).");
}
