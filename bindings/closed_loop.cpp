// External inputs of a closed loop: faults, time series, controllers and plants in Python.
#include "loop_of.h"

Faults::Faults(const nb::dict &arrays, bool beside, size_t n, const LoopOf &of)
{
  const auto series = [&](const char *name, size_t columns) {
    kept.push_back(nb::cast<Samples>(arrays[name]));
    same_length(n, samples_of(kept.back(), columns, name), name);
    return kept.back().data();
  };
  const size_t m = of.sensors(), p = of.axes();
  to = {beside,
        series("late", m),
        series("y_times", m),
        series("y_plus", m),
        series("u_times", p),
        series("u_plus", p),
        series("current", p)};
}

bool OwnOf::ask(std::initializer_list<const amb_real *> from, amb_real to[]) const
{
  nb::gil_scoped_acquire acquire;
  nb::list arguments[3];
  size_t at = 0;
  for (const amb_real *numbers : from) {
    for (size_t i = 0; (numbers != nullptr) && (i < counts[at]); i++)
      arguments[at].append(numbers[i]);
    at++;
  }
  const nb::object result = answer(arguments[0], arguments[1], arguments[2]);
  for (size_t i = 0; i < answers; i++)
    to[places[i]] = nb::cast<amb_real>(result[i]);
  return nb::len(result) > answers && nb::cast<amb_real>(result[answers]) > 0;
}

const amb_real *ClosedLoop::series(nb::handle values, size_t n, size_t columns, const char *name)
{
  if (values.is_none())
    return nullptr;
  kept.push_back(nb::cast<Samples>(values));
  same_length(n, samples_of(kept.back(), columns, name), name);
  return kept.back().data();
}

ClosedLoop::ClosedLoop(const nb::dict &loop, Arguments &named)
    : estimator(named.or_else<Estimator *>("estimator", nullptr)),
      control(named.or_else<Control *>("control", nullptr)), of(loop, estimator, control),
      keeps{nb::find(estimator), nb::find(control)}, place(named.must<Vector>("place")),
      current(named.must<Vector>("current")), integral(named.must<Vector>("integral")),
      hovers(named.or_else<bool>("hovers", true))
{
  const size_t p = of.axes();
  const auto r = named.must<Samples>("r");
  const size_t n = in.n = samples_of(r, p, "r");
  of.check_start(place, current, integral);
  kept.push_back(r);
  in.r = r.data();
  in.load = series(named.take("load"), n, p, "load");
  in.speed = series(named.take("speed"), n + 1, 1, "speed");
  in.rotation = series(named.take("rotation"), n, ROTATION_FIELDS, "rotation");
  in.base = series(named.take("base"), n, 3, "base");
  in.scale = series(named.take("scale"), n, 1, "scale");
  in.fly = series(named.take("fly"), n, 1, "fly");
  in.on = series(named.take("on"), n, 1, "on");
  const bool beside = named.or_else<bool>("beside", false);
  const nb::object wrong = named.take("faults");
  if (!wrong.is_none())
    in.faults = &faults.emplace(nb::cast<nb::dict>(wrong), beside, n, of).to;
  if (!of.loop.plant.own && in.speed == nullptr)
    throw std::invalid_argument("a plant of several axes needs a speed");
  set_model(named.or_else<Model *>("model", nullptr));
  const nb::object own_controller = named.take("own_controller");
  set_own(own_controller, named.take("own_plant"));
}

void ClosedLoop::set_model(Model *model)
{
#if defined(AMB_MODEL_LOOPS)
  if (estimator == nullptr || model == nullptr || !model->turns())
    return;
  if (in.speed == nullptr)
    throw std::invalid_argument("a model that turns needs a speed");
  turning = {estimator, model};
  of.loop.turn = &Turning::turn;
  of.loop.turn_by = &Turning::turn_by;
  of.loop.model = &turning;
#else
  (void)model; // an isolated axis does not rotate
#endif
}

void ClosedLoop::set_own(const nb::object &own_controller, const nb::object &own_plant)
{
  const size_t p = of.axes(), m = of.sensors();
  amb_loop &loop = of.loop;
  if (!own_controller.is_none()) {
    const size_t states = estimator ? estimator->sizes().states : 0;
    controller.emplace(OwnOf{nb::cast<nb::callable>(own_controller), {m, p, states}, p, {}});
    for (size_t c = 0; c < p; c++)
      controller->places.push_back(c);
    loop.own.control = [](void *self, const amb_real y[], const amb_real r[], const amb_real mean[],
                          amb_real iu[]) {
      (void)static_cast<const OwnOf *>(self)->ask({y, r, mean}, iu);
    };
    loop.own.controller = &*controller;
  }
  if (!own_plant.is_none()) {
    plant.emplace(OwnOf{nb::cast<nb::callable>(own_plant), {p, p, 0}, 0, {}});
    for (int j = 0; j < (loop.plant.own ? 2 : 2 * loop.plant.positions); j++)
      plant->places.push_back(static_cast<size_t>(j));
    for (size_t r = 0; r < m; r++)
      plant->places.push_back(static_cast<size_t>(loop.plant.shows[r]));
    plant->answers = plant->places.size();
    loop.own.move = [](void *self, const amb_real iu[], const amb_real load[], amb_real X[]) {
      return static_cast<const OwnOf *>(self)->ask({iu, load, nullptr}, X);
    };
    loop.own.plant = &*plant;
  }
}
