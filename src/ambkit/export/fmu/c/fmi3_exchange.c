/* FMI 3.0 for model exchange, in addition to fmi3.c. */
#include "exchange.h"
#include "fmi3.h"

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible,
                                          fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
  return amb_fmi3_instance(instantiationToken, instanceEnvironment, logMessage, true);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
  return (fmi3Status)amb_to_events(amb_fmi3_of(instance));
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
  bool jumped = false;
  const amb_answer answer = amb_update(amb_fmi3_of(instance), &jumped);
  *discreteStatesNeedUpdate = fmi3False;
  *terminateSimulation = fmi3False;
  *nominalsOfContinuousStatesChanged = fmi3False;
  *valuesOfContinuousStatesChanged = jumped;
  *nextEventTimeDefined = fmi3False;
  *nextEventTime = 0;
  return (fmi3Status)answer;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
  return (fmi3Status)amb_to_continuous(amb_fmi3_of(instance));
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance,
                                       fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode,
                                       fmi3Boolean *terminateSimulation)
{
  *enterEventMode = fmi3False;
  *terminateSimulation = fmi3False;
  return (fmi3Status)amb_step_completed(amb_fmi3_of(instance));
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
  return (fmi3Status)amb_set_time(amb_fmi3_of(instance), time);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
  return (fmi3Status)amb_set_states(amb_fmi3_of(instance), continuousStates, nContinuousStates);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates)
{
  return (fmi3Status)amb_get_slopes(amb_fmi3_of(instance), derivatives, nContinuousStates);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[],
                                  size_t nEventIndicators)
{
  return (fmi3Status)amb_get_indicators(amb_fmi3_of(instance), eventIndicators, nEventIndicators);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
  return (fmi3Status)amb_get_states(amb_fmi3_of(instance), continuousStates, nContinuousStates);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[],
                                             size_t nContinuousStates)
{
  return (fmi3Status)amb_get_nominals(amb_fmi3_of(instance), nominals, nContinuousStates);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
  *nEventIndicators = AMB_EVENT_INDICATORS;
  return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
  *nContinuousStates = AMB_CONTINUOUS_STATES;
  return fmi3OK;
}
