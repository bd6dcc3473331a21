// A thin module: arrays in, arrays out, no logic. Built four times: in double and float, with the
// built-in model and for any model.
#include "arrays.h"

NB_MODULE(AMBKIT_MODULE_NAME, m)
{
  m.doc() = "The C core of ambkit.";
  nb::set_leak_warnings(false); // caches of Python hold estimators until the process ends
  bind_magnets(m);
  bind_model(m);
  bind_sampling(m);
  bind_settings(m);
  bind_estimator(m);
  bind_estimators(m);
  bind_own(m);
  bind_scale_estimators(m);
  bind_learners(m);
  bind_rls(m);
  bind_isolation(m);
  bind_angle(m);
  bind_control(m);
  bind_loop(m);
  bind_batch(m);
  bind_many(m);
}
