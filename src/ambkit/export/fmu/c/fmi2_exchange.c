/* FMI 2.0 for model exchange, in addition to fmi2.c. */
#include "exchange.h"
#include "fmi2Functions.h"

static amb_instance *of(fmi2Component c)
{
  return (amb_instance *)c; /* its first member */
}

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
  return (fmi2Status)amb_to_events(of(c));
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
  bool jumped = false;
  const amb_answer answer = amb_update(of(c), &jumped);
  const fmi2EventInfo info = {.valuesOfContinuousStatesChanged = jumped ? fmi2True : fmi2False};
  *fmi2eventInfo = info;
  return (fmi2Status)answer;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
  return (fmi2Status)amb_to_continuous(of(c));
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c,
                                       fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode,
                                       fmi2Boolean *terminateSimulation)
{
  *enterEventMode = fmi2False;
  *terminateSimulation = fmi2False;
  return (fmi2Status)amb_step_completed(of(c));
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
  return (fmi2Status)amb_set_time(of(c), time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
  return (fmi2Status)amb_set_states(of(c), x, nx);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
  return (fmi2Status)amb_get_slopes(of(c), derivatives, nx);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
  return (fmi2Status)amb_get_indicators(of(c), eventIndicators, ni);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
  return (fmi2Status)amb_get_states(of(c), x, nx);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
  return (fmi2Status)amb_get_nominals(of(c), x_nominal, nx);
}
