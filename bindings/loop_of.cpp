#include "loop_of.h"

amb_parts parts_of(const nb::dict &fields)
{
  amb_parts parts{};
  nb::dict rest;
  rest.update(fields);
  const auto take = [&rest](const char *name, auto &to) {
    if (rest.contains(name)) {
      to = nb::cast<std::decay_t<decltype(to)>>(rest[name]);
      nb::del(rest[name]);
    }
  };
  const auto take_each = [&](const char *name, int count, amb_real *to) {
    if (rest.contains(name)) {
      const Vector values = nb::cast<Vector>(rest[name]);
      same_length(static_cast<size_t>(count), values.size(), name);
      std::copy_n(values.data(), values.size(), to);
      nb::del(rest[name]);
    }
  };
  take("corner", parts.corner);
  take("voltage", parts.voltage);
  take("R", parts.R);
  take("k", parts.k);
  take("s0", parts.s0);
  take("i0", parts.i0);
  take("pair", parts.pair);
  take("behind", parts.behind);
  take("behind_d", parts.behind_d);
  take("quadratic", parts.quadratic);
  take("cubic", parts.cubic);
  take("step", parts.step);
  take("rise", parts.rise);
  take("orders", parts.orders);
  take("speed", parts.speed);
  take("stiffness", parts.stiffness);
  take("damping", parts.damping);
  take("friction", parts.friction);
  take("radius", parts.radius);
  if (parts.orders < 0 || parts.orders > AMB_RUNOUT_MOST)
    throw std::invalid_argument("orders must be 0 to " + std::to_string(AMB_RUNOUT_MOST));
  if (parts.behind < 0 || parts.behind > AMB_BEHIND_MOST)
    throw std::invalid_argument("a plant has 0 to " + std::to_string(AMB_BEHIND_MOST) +
                                " states between a magnet and the rotor");
  take_each("runout_cosine", parts.orders, parts.runout_cosine);
  take_each("runout_sine", parts.orders, parts.runout_sine);
  take_each("behind_A", parts.behind * parts.behind, parts.behind_A);
  take_each("behind_b", parts.behind, parts.behind_b);
  take_each("behind_c", parts.behind, parts.behind_c);
  take_each("behind_rest", parts.behind, parts.behind_rest);
  for (const auto &[name, value] : rest)
    throw std::invalid_argument(std::string("a plant has no part ") + nb::str(name).c_str());
  return parts;
}

amb_real LoopOf::number(const char *name) const
{
  return nb::cast<amb_real>(fields[name]);
}

int LoopOf::count(const char *name) const
{
  return nb::cast<int>(fields[name]);
}

const amb_real *LoopOf::numbers(const char *name, size_t n)
{
  return reals.numbers(fields, name, n);
}

const int *LoopOf::places(const char *name, size_t n, int most, int least)
{
  ints.push_back(nb::cast<std::vector<int>>(fields[name]));
  same_length(n, ints.back().size(), name);
  for (const int at : ints.back())
    if (at < least || at >= most)
      throw std::invalid_argument(std::string(name) + " is out of range");
  return ints.back().data();
}

Rows::Rows(const nb::tuple &parts, size_t count, size_t columns, const char *name)
    : start(nb::cast<std::vector<unsigned short>>(parts[0])),
      column(nb::cast<std::vector<unsigned short>>(parts[1])),
      value(nb::cast<std::vector<amb_real>>(parts[2]))
{
  same_length(count + 1, start.size(), name);
  same_length(start.back(), column.size(), name);
  same_length(start.back(), value.size(), name);
  for (size_t i = 0; i < count; i++)
    if (start[i + 1] < start[i])
      throw std::invalid_argument(std::string(name) + ": rows must ascend");
  for (const unsigned short at : column)
    if (at >= columns)
      throw std::invalid_argument(std::string(name) + ": a column is out of range");
  to = {start.data(), column.data(), value.data()};
}

amb_sparse LoopOf::rows(const char *name, size_t count, size_t columns)
{
  return all_rows.emplace_back(nb::cast<nb::tuple>(fields[name]), count, columns, name).to;
}

std::vector<amb_parts> LoopOf::all_parts(const char *name, size_t n) const
{
  std::vector<amb_parts> all;
  for (const auto item : nb::cast<nb::list>(fields[name]))
    all.push_back(parts_of(nb::cast<nb::dict>(item)));
  same_length(n, all.size(), name);
  return all;
}

void LoopOf::set_plant()
{
  const auto within = [this](const char *what, size_t most) {
    const int n = count(what);
    if (n < 1 || n > static_cast<int>(most))
      throw std::invalid_argument("a machine has 1 to " + std::to_string(most) + " " + what +
                                  ", got " + std::to_string(n));
    return n;
  };
  amb_plant &at = loop.plant;
  const int n = at.states = within("states", AMB_PLANT_STATES);
  const auto p = static_cast<size_t>(at.axes = within("axes", AMB_FORCES));
  const auto m = static_cast<size_t>(at.sensors = within("sensors", AMB_SENSORS));
  const auto q =
      static_cast<size_t>(at.positions = within("positions", static_cast<size_t>(n / 2)));
  at.own = fields.contains("mass");
  if (at.own) {
    same_length(q, p, "axes of their own");
    same_length(q, m, "sensors of their own");
    at.mass = numbers("mass", q);
    at.plain = nb::cast<bool>(fields["plain"]);
  } else {
    at.H = rows("H", p, q);
    at.B = rows("B", q, p);
    at.C = rows("C", m, q);
    at.A = rows("A", q, 2 * q);
    at.spin = numbers("spin", at.A.start[q]);
    at.base = places("base", 3, at.positions, -1);
  }
  at.current = places("current", p, n, -1);
  at.second = places("second", p, n, -1);
  at.bias = numbers("bias", p);
  at.farthest = numbers("farthest", p);
  at.g = numbers("g", q);
  if (fields.contains("cosine")) {
    at.cosine = numbers("cosine", q);
    at.sine = numbers("sine", q);
  }
  at.shows = places("shows", m, n, 0);
  at.gain = numbers("gain", m);
  at.lag = numbers("lag", m);
  sensor_parts = all_parts("sensor_parts", m);
  at.sensor = sensor_parts.data();
  set_magnets(p);
  set_rings();
  at.delay = count("delay");
  at.delay_rest = number("delay_rest");
  at.substeps = count("substeps");
  if (at.delay < 0 || at.delay > AMB_DELAY_MOST)
    throw std::invalid_argument("delay must be 0 to " + std::to_string(AMB_DELAY_MOST) +
                                " samples");
  if (at.substeps < 1)
    throw std::invalid_argument("substeps must be at least 1");
}

void LoopOf::set_magnets(size_t p)
{
  amb_plant &at = loop.plant;
  for (const auto item : nb::cast<nb::list>(fields["magnets"]))
    magnets.push_back(nb::cast<const Magnet &>(item).magnet);
  same_length(p, magnets.size(), "magnets");
  at.magnet = magnets.data();
  for (const auto item : nb::cast<nb::list>(fields["coils"]))
    coils.push_back(item.is_none() ? amb_magnet{} : nb::cast<const Magnet &>(item).magnet);
  same_length(p, coils.size(), "coils");
  at.coil = coils.data();
  amplifiers = all_parts("amplifiers", p);
  for (size_t f = 0; f < p; f++)
    if ((amplifiers[f].corner > 0 || at.second[f] >= 0) && at.current[f] < 0)
      throw std::invalid_argument("an amplifier that lags has no current");
  const auto behind = nb::cast<nb::list>(fields["behind"]);
  same_length(p, behind.size(), "behind");
  for (size_t f = 0; f < p; f++) {
    const auto where = nb::cast<std::vector<int>>(behind[f]);
    same_length(static_cast<size_t>(amplifiers[f].behind), where.size(), "behind");
    for (size_t k = 0; k < where.size(); k++) {
      if (where[k] < 0 || where[k] >= at.states)
        throw std::invalid_argument("behind: there is no such state");
      amplifiers[f].behind_at[k] = where[k];
    }
  }
  at.amplifier = amplifiers.data();
}

void LoopOf::set_rings()
{
  amb_plant &at = loop.plant;
  for (const auto item : nb::cast<nb::list>(fields["rings"])) {
    const auto ring = nb::cast<nb::dict>(item);
    const int first = nb::cast<int>(ring["first"]), second = nb::cast<int>(ring["second"]);
    if (first < 0 || first >= at.axes || second < -1 || second >= at.axes)
      throw std::invalid_argument("a ring is about axes that are not there");
    stops.push_back(parts_of(nb::cast<nb::dict>(ring["stop"])));
    rings.push_back({first, second, nb::cast<amb_real>(ring["travel"]), &stops.back()});
    if (second >= 0 && ring.contains("coupling"))
      couple(first, second, nb::cast<nb::dict>(ring["coupling"]));
  }
  at.couplings = static_cast<int>(couplings.size());
  at.coupling = couplings.data();
  at.rings = static_cast<int>(rings.size());
  at.ring = rings.data();
}

void LoopOf::couple(int first, int second, const nb::dict &fields)
{
  ints.push_back(nb::cast<std::vector<int>>(fields["degrees"]));
  const std::vector<int> &degrees = ints.back();
  for (const int degree : degrees)
    if (degree < 0 || degree >= AMB_COUPLING_DEGREES)
      throw std::invalid_argument("a coupling's degree is out of range");
  const size_t terms = degrees.size() / 4;
  couplings.push_back({first, second, static_cast<int>(terms), degrees.data(),
                       reals.numbers(fields, "energy", terms),
                       nb::cast<amb_real>(fields["current"]), nb::cast<amb_real>(fields["place"])});
}

void LoopOf::set_controllers(Estimator *estimator)
{
  const size_t p = axes();
  loop.T = number("T");
  loop.k_ui = numbers("k_ui", p);
  loop.feedback_estimate = nb::cast<bool>(fields["feedback_estimate"]);
  if (loop.feedback_estimate && estimator == nullptr)
    throw std::invalid_argument("feedback from the estimate needs an estimator");
  if (fields.contains("spread")) {
    law.set(fields, loop.T, p, loop.feedback_estimate ? estimator->sizes().states : sensors());
    loop.controllers = &law.law;
    loop.iu_min = law.law.iu_min;
    loop.iu_max = law.law.iu_max;
    return;
  }
  loop.pid = pid_of(fields["pid"], loop.T, reals);
  loop.iu_min = &loop.pid.iu_min;
  loop.iu_max = &loop.pid.iu_max;
  same_length(p, 1, "the one PID, in axes,");
  if (loop.feedback_estimate)
    estimator->must_have({AMB_POSITION, AMB_VELOCITY}, "feedback from the estimate");
}

LoopOf::LoopOf(const nb::dict &fields, Estimator *estimator, Control *control) : fields(fields)
{
  if (control != nullptr && &control->estimator != estimator)
    throw std::invalid_argument("the controller has another estimator than the loop");
  set_plant();
  if (estimator != nullptr) {
    loop.estimator = &estimator->estimator;
    const Sizes of = estimator->sizes();
    same_length(sensors(), of.sensors, "the estimator, in sensors,");
    same_length(axes(), of.controls, "the estimator, in controls,");
  }
  set_controllers(estimator);
  loop.control = control ? &control->control : nullptr;
}

void LoopOf::check_start(const Vector &q, const Vector &current, const Vector &integral) const
{
  const int pids = loop.controllers != nullptr ? loop.controllers->pids : 1;
  same_length(static_cast<size_t>(loop.plant.positions), q.size(), "place");
  same_length(axes(), current.size(), "current");
  same_length(static_cast<size_t>(pids), integral.size(), "integral");
}

void LoopOf::settle(amb_loop_state &state, const Vector &q, const Vector &current,
                    const Vector &integral, bool hovers, void *estimator) const
{
  amb_plant_settle(&loop.plant, &state.plant, q.data(), current.data());
  for (size_t c = 0; c < integral.size(); c++)
    amb_pid_reset(&state.pid[c], integral.data()[c]);
  if (loop.control == nullptr)
    return;
  if (hovers)
    amb_control_levitate(loop.control, &state.control, current.data(), integral.data());
  else
    amb_control_init(loop.control, &state.control, estimator);
  std::copy_n(state.control.u, axes(), state.u);
}
