/* A model in continuous time, for importers that integrate it themselves (model exchange).
 * description.h has AMB_CONTINUOUS_STATES, 0 where a model is for co-simulation only. */
#ifndef AMBKIT_FMU_EXCHANGE_H
#define AMBKIT_FMU_EXCHANGE_H

#include "instance.h"

#define AMB_EVENT_INDICATORS 2

/* What a model says of itself. How it goes on needs time since the start [s], inputs and parameters
 * among the values, and its states; their order is that of the variables. */
extern const double amb_nominals[]; /* typical sizes of the states */
void amb_unit_follow(amb_unit *model, double time, const double value[AMB_VARIABLES]);
void amb_unit_states(const amb_unit *model, double states[]);
void amb_unit_set_states(amb_unit *model, const double states[]);
void amb_unit_slopes(const amb_unit *model, const double value[AMB_VARIABLES], double slopes[]);
/* What changes its sign where something else begins. */
void amb_unit_indicators(const amb_unit *model, const double value[AMB_VARIABLES],
                         double indicators[AMB_EVENT_INDICATORS]);
/* That begins, or does not; returns whether states have jumped. */
bool amb_unit_event(amb_unit *model, const double value[AMB_VARIABLES]);

/* The standard's calls, as FMI 2.0 and 3.0 share them. */
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
