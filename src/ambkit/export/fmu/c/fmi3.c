/* FMI 3.0: the standard's functions, each forwarded to instance.c. Arguments that this model does
 * not need, such as a tolerance, are unused. */
#include "fmi3.h"
#include <stdlib.h>
#include <string.h>

typedef struct component {
  amb_instance instance; /* first, so that a pointer to it is a pointer to the component */
  fmi3LogMessageCallback logger;
  fmi3InstanceEnvironment environment;
} component;

static void tell(const amb_instance *self, amb_answer answer, const char *text)
{
  const component *c = (const component *)self;
  if (c->logger != NULL)
    c->logger(c->environment, (fmi3Status)answer, amb_category(answer), text);
}

amb_instance *amb_fmi3_of(fmi3Instance instance)
{
  return &((component *)instance)->instance;
}

fmi3Status amb_fmi3_refuse(fmi3Instance instance, const char *text)
{
  return (fmi3Status)amb_refuse(amb_fmi3_of(instance), AMB_ERROR, "%s", text);
}

const char *fmi3GetVersion(void)
{
  return fmi3Version;
}

/* Only errors are logged, and they always are. */
fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
  return fmi3OK;
}

/* A new component that can log, or NULL. */
static component *make(fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
  component *c = (component *)calloc(1, sizeof *c);
  if (c != NULL) {
    c->instance.tell = tell;
    c->logger = logger;
    c->environment = environment;
  }
  return c;
}

fmi3Instance amb_fmi3_instance(fmi3String token, fmi3InstanceEnvironment environment,
                               fmi3LogMessageCallback logger, bool exchange)
{
  component *c = make(environment, logger);
  if ((c != NULL) && !amb_same_token(&c->instance, token)) {
    free(c);
    c = NULL;
  }
  if (c != NULL) {
    c->instance.follow = exchange ? amb_exchange : NULL;
    amb_reset(&c->instance);
  }
  return c;
}

fmi3Instance amb_fmi3_not_provided(fmi3InstanceEnvironment environment,
                                   fmi3LogMessageCallback logger)
{
  component *c = make(environment, logger);
  if (c != NULL)
    (void)amb_fmi3_refuse(c, "this model is for co-simulation only, without event mode");
  free(c);
  return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
    fmi3LockPreemptionCallback lockPreemption, fmi3UnlockPreemptionCallback unlockPreemption)
{
  return amb_fmi3_not_provided(instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
  if (eventModeUsed)
    return amb_fmi3_not_provided(instanceEnvironment, logMessage);
  return amb_fmi3_instance(instantiationToken, instanceEnvironment, logMessage, false);
}

void fmi3FreeInstance(fmi3Instance instance)
{
  free(instance);
}

/* ---- Changes of the mode ---- */

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined,
                                       fmi3Float64 tolerance, fmi3Float64 startTime,
                                       fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
  return (fmi3Status)amb_enter_initialization(amb_fmi3_of(instance), startTime);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
  return (fmi3Status)amb_exit_initialization(amb_fmi3_of(instance));
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
  return (fmi3Status)amb_terminate(amb_fmi3_of(instance));
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
  amb_reset(amb_fmi3_of(instance));
  return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
                      fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
                      fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
  const amb_answer answer =
      amb_do_step(amb_fmi3_of(instance), currentCommunicationPoint, communicationStepSize);
  *eventHandlingNeeded = fmi3False;
  *terminateSimulation = fmi3False;
  *earlyReturn = fmi3False;
  *lastSuccessfulTime = amb_time(amb_fmi3_of(instance));
  return (fmi3Status)answer;
}

/* ---- Variables, scalars only ---- */

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                          size_t nValueReferences, fmi3Float64 values[], size_t nValues)
{
  if (nValues != nValueReferences)
    return amb_fmi3_refuse(instance, "as many values as value references are expected");
  return (fmi3Status)amb_get_reals(amb_fmi3_of(instance), valueReferences, nValues, values);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                          size_t nValueReferences, const fmi3Float64 values[], size_t nValues)
{
  if (nValues != nValueReferences)
    return amb_fmi3_refuse(instance, "as many values as value references are expected");
  return (fmi3Status)amb_set_reals(amb_fmi3_of(instance), valueReferences, nValues, values);
}

fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, fmi3Int32 values[], size_t nValues)
{
  if (nValues != nValueReferences)
    return amb_fmi3_refuse(instance, "as many values as value references are expected");
  return (fmi3Status)amb_get_integers(amb_fmi3_of(instance), valueReferences, nValues, values);
}

/* No variables of these types, or none that can be set. */
static fmi3Status none(fmi3Instance instance, size_t n, const char *text)
{
  return n == 0 ? fmi3OK : amb_fmi3_refuse(instance, text);
}

#define NONE_TO_GET(type)                                                                          \
  fmi3Status fmi3Get##type(fmi3Instance instance, const fmi3ValueReference valueReferences[],      \
                           size_t nValueReferences, fmi3##type values[], size_t nValues)           \
  {                                                                                                \
    return none(instance, nValueReferences, "there are no " #type " variables");                   \
  }

#define NONE_TO_SET(type)                                                                          \
  fmi3Status fmi3Set##type(fmi3Instance instance, const fmi3ValueReference valueReferences[],      \
                           size_t nValueReferences, const fmi3##type values[], size_t nValues)     \
  {                                                                                                \
    return none(instance, nValueReferences, "no " #type " variable can be set");                   \
  }

NONE_TO_GET(Float32)
NONE_TO_GET(Int8)
NONE_TO_GET(UInt8)
NONE_TO_GET(Int16)
NONE_TO_GET(UInt16)
NONE_TO_GET(UInt32)
NONE_TO_GET(Int64)
NONE_TO_GET(UInt64)
NONE_TO_GET(Boolean)
NONE_TO_GET(String)

NONE_TO_SET(Float32)
NONE_TO_SET(Int8)
NONE_TO_SET(UInt8)
NONE_TO_SET(Int16)
NONE_TO_SET(UInt16)
NONE_TO_SET(Int32)
NONE_TO_SET(UInt32)
NONE_TO_SET(Int64)
NONE_TO_SET(UInt64)
NONE_TO_SET(Boolean)
NONE_TO_SET(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, size_t valueSizes[], fmi3Binary values[],
                         size_t nValues)
{
  return none(instance, nValueReferences, "there are no Binary variables");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, const size_t valueSizes[],
                         const fmi3Binary values[], size_t nValues)
{
  return none(instance, nValueReferences, "there are no Binary variables");
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, fmi3Clock values[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, const fmi3Clock values[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance,
                                   const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, fmi3Float64 shifts[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, const fmi3Float64 intervals[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance,
                                   const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, const fmi3Float64 shifts[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[])
{
  return none(instance, nValueReferences, "there are no clocks");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance,
                                    const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t nValues)
{
  return none(instance, nValueReferences, "outputs have no derivatives");
}

/* ---- State ---- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
  return (fmi3Status)amb_save(amb_fmi3_of(instance), (amb_point **)FMUState);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
  return (fmi3Status)amb_restore(amb_fmi3_of(instance), (const amb_point *)FMUState);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
  if (FMUState != NULL) {
    free(*FMUState);
    *FMUState = NULL;
  }
  return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
  *size = amb_serialized_size();
  return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState,
                                 fmi3Byte serializedState[], size_t size)
{
  return (fmi3Status)amb_serialize(amb_fmi3_of(instance), (const amb_point *)FMUState,
                                   serializedState, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[],
                                   size_t size, fmi3FMUState *FMUState)
{
  return (fmi3Status)amb_deserialize(amb_fmi3_of(instance), serializedState, size,
                                     (amb_point **)FMUState);
}

/* ---- Not provided, according to modelDescription.xml ---- */

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance,
                                               fmi3ValueReference valueReference,
                                               size_t *nDependencies)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[],
                                       fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[],
                                       fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                        size_t nUnknowns, const fmi3ValueReference knowns[],
                                        size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                        fmi3Float64 sensitivity[], size_t nSensitivity)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                    size_t nUnknowns, const fmi3ValueReference knowns[],
                                    size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                    fmi3Float64 sensitivity[], size_t nSensitivity)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference,
                                      fmi3Float64 activationTime)
{
  return amb_fmi3_refuse(instance, NOT_PROVIDED);
}
