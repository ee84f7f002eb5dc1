/* A receding horizon that needs neither Python nor Pyomo, written by RecedingHorizon.export of pyrobocop_pyomo.

   Compile all C files of this folder into one library, with Ipopt (3.14 or newer):

       cc -std=c11 -O3 -ffp-contract=off -fPIC -shared *.c -o controller.so -lipopt -ldl -lm

   The library holds one controller and is for one thread at a time. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

extern const int controller_states, controller_controls, controller_variables;
extern const char *const controller_state_names[];
extern const char *const controller_control_names[];

/* Plan from the measured states, one advance after the last plan was made, and hand out what each control is at first.

   Returns Ipopt's status. After 0, 1 and 6 the plan is a new one; after any other it is the rest of the last plan, whose
   controls are given. */
int controller_step(const double *state, double *control);

/* The last plan: values of all variables of the program. */
const double *controller_plan(void);

#endif
