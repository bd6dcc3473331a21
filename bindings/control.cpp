#include "control.h"

namespace
{

unsigned int counted(const nb::dict &fields, const char *name)
{
  const auto value = nb::cast<unsigned int>(fields[name]);
  if (value > 65535U)
    throw std::invalid_argument(std::string(name) + " must be at most 65535");
  return value;
}

// State at each sample of a recorded run: means (n, states), control signals (n, p) and upper
// triangles (n, entries).
struct Recorded {
  explicit Recorded(const Named &of)
      : mean(nb::cast<Samples>(of["mean"])), u(nb::cast<Samples>(of["u"])),
        covariance(nb::cast<Samples>(of["covariance"])), snapshot(nb::cast<Vector>(of["snapshot"]))
  {
  }

  // State before sample k of n, as in the exported self-test; the covariance if there is a
  // snapshot.
  void restore(const Control &self, size_t k, amb_control_state &state,
               amb_kalman_state &filter) const
  {
    const size_t entries = self.n * (self.n + 1) / 2;
    std::copy_n(mean.data() + (k - 1) * self.n, self.n, filter.mean);
    std::copy_n(u.data() + (k - 1) * self.p, self.p, state.u);
    if (snapshot.data()[k] > 0)
      std::copy_n(covariance.data() + (k - 1) * entries, entries, filter.cov);
  }

  Samples mean, u, covariance;
  Vector snapshot;
};

// Runs the controller along a record from power-on; the estimator keeps its final state.
Named run(Control &self, const Samples &y, const Samples &r, const Vector &fly, amb_real speed,
          const std::optional<Vector> &transferred, const std::optional<Named> &recorded,
          const std::optional<Vector> &energised)
{
  const size_t n = samples_of(y, self.m, "y"), entries = self.n * (self.n + 1) / 2;
  same_length(n, samples_of(r, self.q, "r"), "r");
  same_length(n, fly.size(), "fly");
  if (energised)
    same_length(n, energised->size(), "energised");
  if (transferred)
    same_length(self.p, transferred->size(), "transferred");
  std::optional<Recorded> from;
  if (recorded) {
    from.emplace(*recorded);
    same_length(n, samples_of(from->mean, self.n, "mean"), "mean");
    same_length(n, samples_of(from->u, self.p, "u"), "u");
    same_length(n, samples_of(from->covariance, entries, "covariance"), "covariance");
    same_length(n, from->snapshot.size(), "snapshot");
  }
  Fresh<amb_real> iu({n, self.p}), u({n, self.p}), mean({n, self.n}), share({n});
  Fresh<amb_real> covariance({n, entries});
  Fresh<unsigned short> status({n});
  Fresh<unsigned char> mode({n}), on({n}), usable({n});
  {
    nb::gil_scoped_release release;
    amb_control_state state;
    amb_control_output out;
    void *filter = self.estimator.state();
    if (transferred && n > 0)
      amb_control_transfer(&self.control, &state, filter, y.data(), transferred->data());
    else
      amb_control_init(&self.control, &state, filter);
    for (size_t k = 0; k < n; k++) {
      if (from && k > 0)
        from->restore(self, k, state, *static_cast<amb_kalman_state *>(filter));
      status.data[k] = static_cast<unsigned short>(
          amb_control_step(&self.control, &state, filter, y.data() + k * self.m,
                           r.data() + k * self.q, speed, fly.data()[k] > 0, &out));
      if (energised && !(energised->data()[k] > 0))
        amb_control_deenergise(&self.control, &state, filter);
      std::copy_n(out.iu, self.p, iu.data + k * self.p);
      std::copy_n(state.u, self.p, u.data + k * self.p);
      std::copy_n(self.estimator.base().mean, self.n, mean.data + k * self.n);
      std::copy_n(static_cast<const amb_kalman_state *>(filter)->cov, entries,
                  covariance.data + k * entries);
      share.data[k] = state.sequence.share;
      mode.data[k] = static_cast<unsigned char>(out.mode);
      on.data[k] = out.on;
      usable.data[k] = out.usable;
    }
  }
  nb::dict d;
  d["iu"] = iu.array;
  d["u"] = u.array;
  d["mean"] = mean.array;
  d["covariance"] = covariance.array;
  d["share"] = share.array;
  d["status"] = status.array;
  d["mode"] = mode.array;
  d["on"] = on.array;
  d["usable"] = usable.array;
  return d;
}

} // namespace

amb_pid pid_of(nb::handle numbers, amb_real T, Kept &kept)
{
  const size_t n = nb::len(numbers), sections = n < 8 ? 0 : (n - 8) / AMB_SECTION;
  same_length(8 + AMB_SECTION * sections, n, "pid");
  if (sections > AMB_SECTIONS)
    throw std::invalid_argument("a controller has at most " + std::to_string(AMB_SECTIONS) +
                                " sections of second order, got " + std::to_string(sections));
  const amb_real *of = kept.keep(numbers, n, "pid");
  return {T,     of[0], of[1], of[2], of[3], of[4], of[5], of[6], of[7], static_cast<int>(sections),
          &of[8]};
}

void Law::set(const nb::dict &fields, amb_real T, size_t p, size_t seen)
{
  for (const auto item : nb::cast<nb::list>(fields["pid"])) {
    pid.push_back(pid_of(item, T, kept));
  }
  const size_t q = pid.size();
  if (q < 1 || q > AMB_CONTROLS)
    throw std::invalid_argument("there are more controllers than a machine can have, or none");
  law.axes = static_cast<int>(p);
  law.states = static_cast<int>(seen);
  law.pids = static_cast<int>(q);
  law.pid = pid.data();
  law.reference = kept.or_none(fields, "reference", q * p);
  law.position = kept.numbers(fields, "position", q * seen);
  law.velocity = kept.or_none(fields, "velocity", q * seen);
  law.spread = kept.numbers(fields, "spread", p * q);
  law.gain[0] = kept.or_none(fields, "fed_back", p * seen);
  law.gain[1] = kept.or_none(fields, "fed_back_by_speed", p * seen);
  law.gain[2] = kept.or_none(fields, "fed_back_by_square", p * seen);
  law.iu_min = kept.numbers(fields, "iu_min", p);
  law.iu_max = kept.numbers(fields, "iu_max", p);
  if (!fields["unbalance_control_motion"].is_none())
    set_unbalance_control(fields, p, seen);
  set_schedule(fields, q);
}

void Law::set_unbalance_control(const nb::dict &fields, size_t p, size_t seen)
{
  const auto at = [&](const char *name) { return nb::cast<size_t>(fields[name]); };
  const size_t nodes = at("unbalance_control_nodes"), from = at("unbalance_control_from");
  const size_t width = at("unbalance_control_width"), moved = at("unbalance_control_moved");
  const auto step = nb::cast<amb_real>(fields["unbalance_control_step"]);
  if (nodes < 2 || seen > AMB_UNBALANCE_STATES || from + width > seen || moved > seen ||
      width > AMB_UNBALANCE_WIDTH || p > AMB_UNBALANCE_AXES || width % 2 != 0 || moved % 2 != 0 ||
      (!(step > 0) && !(step < 0)))
    throw std::invalid_argument("a motion that is left to the rotor: there are not these states");
  unbalance_control = {static_cast<int>(nodes),
                       static_cast<int>(from),
                       static_cast<int>(width),
                       static_cast<int>(moved),
                       nb::cast<amb_real>(fields["unbalance_control_first"]),
                       step,
                       kept.numbers(fields, "unbalance_control_motion", nodes * moved * width),
                       kept.numbers(fields, "unbalance_control_current", nodes * p * width),
                       kept.numbers(fields, "unbalance_control_reach", p * moved / 2),
                       kept.numbers(fields, "unbalance_control_ampere", p)};
  law.unbalance_control = &unbalance_control;
}

void Law::set_schedule(const nb::dict &fields, size_t q)
{
  const nb::handle speeds = fields["schedule_speed"];
  if (speeds.is_none())
    return;
  const size_t nodes = nb::len(speeds);
  if (nodes < 1)
    throw std::invalid_argument("schedule_speed: there must be a speed");
  schedule = {static_cast<int>(nodes), kept.numbers(fields, "schedule_speed", nodes),
              kept.numbers(fields, "schedule_gain", nodes * q * AMB_SCHEDULED)};
  law.schedule = &schedule;
}

Control::Control(Estimator &of, const nb::dict &fields) : estimator(of)
{
  const Sizes sizes = of.sizes();
  n = sizes.states;
  m = sizes.sensors;
  p = sizes.controls;
  const auto numbers = [&](const char *name, size_t count) -> const amb_real * {
    return kept.numbers(fields, name, count);
  };
  const bool fed = nb::cast<bool>(fields["feedback_estimate"]);
  law.set(fields, of.kf.set.T, p, fed ? n : m);
  q = static_cast<size_t>(law.law.pids);
  const bool sequenced = nb::cast<bool>(fields["sequenced"]);
  if (sequenced)
    sequence = {counted(fields, "waiting"), counted(fields, "lost"), counted(fields, "overloaded"),
                nb::cast<amb_real>(fields["rise"]), nb::cast<amb_real>(fields["descent"])};
  control.estimator = &of.estimator;
  control.law = &law.law;
  control.sequence = sequenced ? &sequence : nullptr;
  control.feedback_estimate = fed;
  control.settling = counted(fields, "settling");
  control.bound = nb::cast<amb_real>(fields["bound"]);
  control.std = numbers("std", n);
  control.start = numbers("start", n);
  control.start_by = numbers("start_by", n * m);
  control.place = numbers("place", p * n);
  control.down = numbers("down", p);
  control.hold = numbers("hold", q);
  control.hold_by = numbers("hold_by", q * p);
}

void bind_control(nb::module_ &m)
{
  nb::class_<Control>(m, "Control", "The whole controller (ambkit/control.h).")
      .def(nb::init<Estimator &, const Named &>(), nb::arg("estimator"), nb::arg("fields"),
           nb::sig("def __init__(self, estimator: Estimator, fields: dict[str, Any]) -> None"),
           nb::keep_alive<1, 2>())
      .def("run", &run, nb::arg("y"), nb::arg("r"), nb::arg("fly"), nb::arg("speed") = 0,
           nb::arg("transferred").none() = nb::none(), nb::arg("recorded").none() = nb::none(),
           nb::arg("energised").none() = nb::none(),
           "A record from power-on: readings (n, m) [m], references (n, q) [m], and whether it is "
           "to fly, 1 or 0. Or in flight from the first sample on, taken over with currents (p,) "
           "[A]. `recorded`: mean, u, covariance and snapshot of each sample, to begin the next "
           "at. `energised`: 0 where the power fails from that sample on.");
}
