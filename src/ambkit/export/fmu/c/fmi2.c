/* FMI 2.0: the standard's functions, each forwarded to instance.c. Arguments that this model does
 * not need, such as a tolerance, are unused. */
#include "fmi2Functions.h"
#include "instance.h"
#include <stdlib.h>
#include <string.h>

typedef struct component {
  amb_instance instance; /* first, so that a pointer to it is a pointer to the component */
  fmi2CallbackLogger logger;
  fmi2ComponentEnvironment environment;
  char name[128];
} component;

static void tell(const amb_instance *self, amb_answer answer, const char *text)
{
  const component *c = (const component *)self;
  char message[512]; /* a format of printf: importers without printf show it unchanged */
  size_t n = 0;
  for (const char *from = text; (*from != '\0') && (n < sizeof message - 2); from++) {
    if (*from == '%')
      message[n++] = '%';
    message[n++] = *from;
  }
  message[n] = '\0';
  if (c->logger != NULL)
    c->logger(c->environment, c->name, (fmi2Status)answer, amb_category(answer), message);
}

static amb_instance *of(fmi2Component c)
{
  return &((component *)c)->instance;
}

static fmi2Status refuse(fmi2Component c, const char *text)
{
  return (fmi2Status)amb_refuse(of(c), AMB_ERROR, "%s", text);
}

const char *fmi2GetTypesPlatform(void)
{
  return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
  return fmi2Version;
}

/* Only errors are logged, and they always are. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean loggingOn)
{
  component *c = (component *)calloc(1, sizeof *c);
  if (c == NULL)
    return NULL;
  c->instance.tell = tell;
  if (functions != NULL) {
    c->logger = functions->logger;
    c->environment = functions->componentEnvironment;
  }
  if (instanceName != NULL)
    strncpy(c->name, instanceName, sizeof c->name - 1);
  bool good = amb_same_token(&c->instance, fmuGUID);
  if (good && (fmuType == fmi2ModelExchange)) {
    good = amb_exchange != NULL;
    c->instance.follow = amb_exchange;
    if (!good)
      (void)refuse(c, "this model is for co-simulation only");
  }
  if (!good) {
    free(c);
    return NULL;
  }
  amb_reset(&c->instance);
  return c;
}

void fmi2FreeInstance(fmi2Component c)
{
  free(c);
}

/* ---- Changes of the mode ---- */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
  if (of(c)->now.mode != AMB_INSTANTIATED)
    return refuse(c, "the experiment is set up before initialization");
  if (!amb_is_finite(startTime))
    return refuse(c, "the start time must be finite");
  of(c)->now.start = startTime;
  return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
  return (fmi2Status)amb_enter_initialization(of(c), of(c)->now.start);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
  return (fmi2Status)amb_exit_initialization(of(c));
}

fmi2Status fmi2Terminate(fmi2Component c)
{
  return (fmi2Status)amb_terminate(of(c));
}

fmi2Status fmi2Reset(fmi2Component c)
{
  amb_reset(of(c));
  return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint,
                      fmi2Real communicationStepSize, fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
  return (fmi2Status)amb_do_step(of(c), currentCommunicationPoint, communicationStepSize);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
  return refuse(c, "no step is under way: each ends before doStep returns");
}

/* ---- Variables ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
  return (fmi2Status)amb_get_reals(of(c), vr, nvr, value);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Integer value[])
{
  return (fmi2Status)amb_get_integers(of(c), vr, nvr, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                       const fmi2Real value[])
{
  return (fmi2Status)amb_set_reals(of(c), vr, nvr, value);
}

/* No variables of these types, or none that can be set. */
static fmi2Status none(fmi2Component c, size_t n, const char *text)
{
  return n == 0 ? fmi2OK : refuse(c, text);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Boolean value[])
{
  return none(c, nvr, "there are no Boolean variables");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         fmi2String value[])
{
  return none(c, nvr, "there are no String variables");
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Integer value[])
{
  return none(c, nvr, "no Integer variable can be set");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Boolean value[])
{
  return none(c, nvr, "there are no Boolean variables");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[])
{
  return none(c, nvr, "there are no String variables");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
  return none(c, nvr, "inputs are held, they have no derivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
  return none(c, nvr, "outputs have no derivatives");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
  return none(c, nUnknown, "directional derivatives are not provided");
}

/* ---- State ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
  return (fmi2Status)amb_save(of(c), (amb_point **)FMUstate);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
  return (fmi2Status)amb_restore(of(c), (const amb_point *)FMUstate);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
  if (FMUstate != NULL) {
    free(*FMUstate);
    *FMUstate = NULL;
  }
  return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
  *size = amb_serialized_size();
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size)
{
  return (fmi2Status)amb_serialize(of(c), (const amb_point *)FMUstate,
                                   (unsigned char *)serializedState, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
  return (fmi2Status)amb_deserialize(of(c), (const unsigned char *)serializedState, size,
                                     (amb_point **)FMUstate);
}

/* ---- Status of the last step ---- */

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
  (void)refuse(c, "no step is pending");
  return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
  if (s != fmi2LastSuccessfulTime)
    return fmi2Discard;
  *value = amb_time(of(c));
  return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
  return fmi2Discard;
}

/* It never terminates a simulation. */
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
  if (s != fmi2Terminated)
    return fmi2Discard;
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
  return fmi2Discard;
}
