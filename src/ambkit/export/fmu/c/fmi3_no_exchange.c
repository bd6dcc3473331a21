/* FMI 3.0 for co-simulation only. */
#include "fmi3.h"

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible,
                                          fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
  return amb_fmi3_not_provided(instanceEnvironment, logMessage);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance,
                                       fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode,
                                       fmi3Boolean *terminateSimulation)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[],
                                  size_t nEventIndicators)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[],
                                             size_t nContinuousStates)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}
