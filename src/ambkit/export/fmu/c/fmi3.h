/* Shared declarations of the FMI 3.0 layer. */
#ifndef AMBKIT_FMU_FMI3_H
#define AMBKIT_FMU_FMI3_H

#include "fmi3Functions.h"
#include "instance.h"

amb_instance *amb_fmi3_of(fmi3Instance instance);
fmi3Status amb_fmi3_refuse(fmi3Instance instance, const char *text);

/* A new instance; `exchange`: its importer integrates. NULL if the token is that of another model,
 * or without memory. */
fmi3Instance amb_fmi3_instance(fmi3String token, fmi3InstanceEnvironment environment,
                               fmi3LogMessageCallback logger, bool exchange);

/* Logs that this type of simulation is not provided; returns NULL. */
fmi3Instance amb_fmi3_not_provided(fmi3InstanceEnvironment environment,
                                   fmi3LogMessageCallback logger);

#define NOT_PROVIDED "not provided by this model"

#endif
