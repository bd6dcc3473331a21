/* A model in continuous time, for importers that integrate it themselves (model exchange).
 * description.h defines AMB_CONTINUOUS_STATES, 0 for a model for co-simulation only. */
#ifndef AMBKIT_FMU_EXCHANGE_H
#define AMBKIT_FMU_EXCHANGE_H

#include "instance.h"

#define AMB_EVENT_INDICATORS 2

/* Functions of a model. Its rates depend on the time since the start [s], inputs and parameters
 * among the values, and its states; their order is that of the variables. */
extern const double amb_nominals[]; /* typical sizes of the states */
void amb_unit_follow(amb_unit *model, double time, const double value[AMB_VARIABLES]);
void amb_unit_states(const amb_unit *model, double states[]);
void amb_unit_set_states(amb_unit *model, const double states[]);
void amb_unit_slopes(const amb_unit *model, const double value[AMB_VARIABLES], double slopes[]);
/* Event indicators: each changes its sign at an event. */
void amb_unit_indicators(const amb_unit *model, const double value[AMB_VARIABLES],
                         double indicators[AMB_EVENT_INDICATORS]);
/* Handles an event; returns whether states have jumped. */
bool amb_unit_event(amb_unit *model, const double value[AMB_VARIABLES]);

/* The standard's calls that FMI 2.0 and 3.0 share. */
amb_answer amb_to_events(amb_instance *self);
amb_answer amb_update(amb_instance *self, bool *jumped);
amb_answer amb_to_continuous(amb_instance *self);
amb_answer amb_step_completed(const amb_instance *self);
amb_answer amb_set_time(amb_instance *self, double time);
amb_answer amb_set_states(amb_instance *self, const double *states, size_t n);
amb_answer amb_get_states(amb_instance *self, double *states, size_t n);
amb_answer amb_get_slopes(amb_instance *self, double *slopes, size_t n);
amb_answer amb_get_indicators(amb_instance *self, double *indicators, size_t n);
amb_answer amb_get_nominals(const amb_instance *self, double *nominals, size_t n);

#endif
