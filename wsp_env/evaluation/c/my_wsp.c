/* A template: a simple wheel slide protection. Fill in your own rules where it says so.
 *
 * It vents an axle that slides, holds until the wheel catches up, and applies again.
 */
#include <stdlib.h>

#include "wsp_controller.h"

WSP_CONTROLLER

enum { MOST_AXLES = 16 };

/* All that one stop remembers. */
typedef struct {
    int32_t axles;
    double radius_m;
    double last_time_s;
    double reference_mps;               /* running speed, as far as the wheels tell */
    double last_mps[MOST_AXLES];
    double command[MOST_AXLES];
    int begun;
} my_wsp;

/* --- your numbers --- */
static const double SLIP_VENTS_MPS = 1.2;          /* slip below the reference speed that vents an axle */
static const double SLIP_APPLIES_MPS = 0.4;        /* slip below which it is applied again */
static const double FASTEST_STOP_MPS2 = 1.4;       /* the vehicle cannot decelerate faster */
static const double CUT_OUT_MPS = 1.4;             /* below this speed the brake is left alone */

int32_t wsp_init(const wsp_vehicle *vehicle, void **controller)
{
    my_wsp *own;
    if (vehicle->interface != WSP_INTERFACE || vehicle->axles > MOST_AXLES) {
        return 1; /* refused */
    }
    own = calloc(1, sizeof *own);
    if (own == NULL) {
        return 2;
    }
    own->axles = vehicle->axles;
    own->radius_m = vehicle->wheel_radius_m;
    *controller = own;
    return 0;
}

int32_t wsp_step(void *controller, const wsp_measurement *seen, double *command)
{
    my_wsp *own = controller;
    const double step = seen->time_s - own->last_time_s;
    double fastest = 0.0;
    int32_t k;
    for (k = 0; k < own->axles; k++) {
        const double wheel = own->radius_m * seen->wheel_speed_radps[k];
        fastest = wheel > fastest ? wheel : fastest;
    }
    if (own->begun) {
        const double slowest = own->reference_mps - FASTEST_STOP_MPS2 * step;
        own->reference_mps = fastest > slowest ? fastest : slowest;
    } else {
        own->reference_mps = fastest;
    }
    for (k = 0; k < own->axles; k++) {
        const double wheel = own->radius_m * seen->wheel_speed_radps[k];
        const double slip = own->reference_mps - wheel;
        const double rate = own->begun && step > 0.0 ? (wheel - own->last_mps[k]) / step : 0.0;
        /* --- your rules --- */
        if (slip > SLIP_VENTS_MPS) {
            own->command[k] = rate > 0.0 ? 0.0 : -1.0; /* hold while the wheel catches up */
        } else if (slip < SLIP_APPLIES_MPS) {
            own->command[k] = 1.0;
        }
        if (!own->begun || own->reference_mps < CUT_OUT_MPS) {
            own->command[k] = 1.0;
        }
        own->last_mps[k] = wheel;
        command[k] = own->command[k];
    }
    own->last_time_s = seen->time_s;
    own->begun = 1;
    return 0;
}

void wsp_free(void *controller)
{
    free(controller);
}
