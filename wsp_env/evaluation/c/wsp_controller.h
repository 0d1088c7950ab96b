/* A wheel slide protection of your own, as `wsp evaluate --controllers mine.so` takes it: three functions and a version.
 *
 * Write them in C (or anything that makes a shared library with C names), build a shared library, evaluate it:
 *
 *     gcc -std=c99 -O2 -shared -fPIC -o mine.so mine.c
 *     wsp evaluate --controllers rule-based ./mine.so --draws 1
 *
 * Several stops run side by side: keep all that you remember in what `wsp_init` hands out, nothing in globals.
 */
#ifndef WSP_CONTROLLER_H
#define WSP_CONTROLLER_H

#include <stdint.h>

#ifdef _WIN32
#define WSP_EXPORT __declspec(dllexport)
#else
#define WSP_EXPORT __attribute__((visibility("default")))
#endif

/* Version of this interface. */
#define WSP_INTERFACE 1

#ifdef __cplusplus
extern "C" {
#endif

/* What brakes; nominal values, the true ones are within tolerances of them. */
typedef struct {
    int32_t interface;             /* WSP_INTERFACE of the caller */
    int32_t axles;                 /* number of wheelsets, from the front */
    double wheel_radius_m;
    double mass_kg;                /* empty */
    double payload_kg;             /* at full load */
    double full_pressure_bar;      /* in the cylinders at full brake */
    double torque_per_bar_nm;      /* brake torque of one axle per bar */
    double demand_rise_s;          /* the distributor's pressure rises from none to full in so long */
    double dead_time_s;            /* of the valves */
    double fill_time_constant_s;   /* of a cylinder */
    double vent_time_constant_s;
} wsp_vehicle;

/* What the sensors say at one moment. */
typedef struct {
    double time_s;                      /* since the start of the stop */
    double demand;                      /* brake demand, 0 to 1 of full pressure */
    const double *wheel_speed_radps;    /* one per axle */
    const double *pressure_bar;         /* one per axle; NULL: the vehicle does not measure them */
} wsp_measurement;

/* Begin a stop: *controller becomes what the other two are given. 0: ready; any other number: refused, and it is reported. */
WSP_EXPORT int32_t wsp_init(const wsp_vehicle *vehicle, void **controller);

/* Decide: one command per axle, -1 vents, 0 holds, +1 applies. 0: decided; any other number: failed, and it is reported. */
WSP_EXPORT int32_t wsp_step(void *controller, const wsp_measurement *seen, double *command);

/* End the stop. */
WSP_EXPORT void wsp_free(void *controller);

/* The version that a library was built for: write WSP_CONTROLLER once in your source. */
extern WSP_EXPORT const int32_t wsp_interface;
#define WSP_CONTROLLER const int32_t wsp_interface = WSP_INTERFACE;

#ifdef __cplusplus
}
#endif

#endif
