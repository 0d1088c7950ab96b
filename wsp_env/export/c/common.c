/* An instance of @name@ for FMI: memory, variables by number, steps. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "@name@.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define INTERVAL @interval@ /* of a step [s]; 0: it has no time */
#define COUNT @count@       /* variables */
#define FIRST_INPUT @first_input@
#define FIRST_OUTPUT @first_output@

typedef struct {
    @name@ self;
    @name@_parameters p;
    @name@_input u;
    @name@_output y;
    double time;
    int initialised;
    int old; /* the outputs do not belong to the inputs */
} instance;

/* Where each variable is, in the order of modelDescription.xml. */
static const size_t AT[COUNT] = {
    @offsets@};

static double *variable(instance *own, unsigned number)
{
    return (double *)(void *)((char *)own + AT[number]);
}

static void begin(instance *own)
{
    memset(own, 0, sizeof *own);
    @name@_defaults(&own->p);
    @starts@
}

static void evaluate(instance *own)
{
    @set_time@
    @name@_step(&own->self, &own->u, &own->y);
    own->old = 0;
}

static void initialise(instance *own)
{
    @name@_start(&own->self, &own->p);
    own->initialised = 1;
    @first_outputs@
}

/* Set a variable; 0 where it cannot be set now. */
static int set(instance *own, unsigned number, double value)
{
    if (number >= FIRST_OUTPUT || (number < FIRST_INPUT && own->initialised)) {
        return 0;
    }
    *variable(own, number) = value;
    own->old = 1;
    return 1;
}

static int get(instance *own, unsigned number, double *value)
{
    if (number >= COUNT) {
        return 0;
    }
    if (INTERVAL == 0.0 && own->old && own->initialised && number >= FIRST_OUTPUT) {
        evaluate(own);
    }
    *value = *variable(own, number);
    return 1;
}

/* Take steps from `time` on for so long; 0 where that is no whole number of intervals. */
static int advance(instance *own, double time, double duration)
{
    long n, steps = 1;
    if (INTERVAL > 0.0) {
        steps = lround(duration / INTERVAL);
        if (steps < 0 || fabs(duration - (double)steps * INTERVAL) > 1e-6 * INTERVAL) {
            return 0;
        }
    }
    for (n = 0; n < steps; n++) {
        own->time = time + (double)n * INTERVAL;
        evaluate(own);
    }
    own->time = time + duration;
    return 1;
}

/* Derivative of variable `of` by input `by`, outputs up to date. */
static double derivative(const instance *own, unsigned of, unsigned by)
{
    instance up, down;
    double step;
    memcpy(&up, own, sizeof up);
    memcpy(&down, own, sizeof down);
    @known_derivatives@
    step = 1e-6 * fmax(fabs(*variable(&up, by)), 1e-3);
    *variable(&up, by) += step;
    *variable(&down, by) -= step;
    evaluate(&up);
    evaluate(&down);
    return (*variable(&up, of) - *variable(&down, of)) / (*variable(&up, by) - *variable(&down, by));
}

/* Sum over the knowns of derivative times seed; 0 where a number is no output or no input. */
static int sensitivity(instance *own, const unsigned *of, size_t outputs, const unsigned *by, size_t inputs,
    const double *seed, double *result)
{
    size_t n, m;
    if (INTERVAL > 0.0 || !own->initialised) {
        return 0;
    }
    evaluate(own);
    for (n = 0; n < outputs; n++) {
        result[n] = 0.0;
        for (m = 0; m < inputs; m++) {
            if (of[n] < FIRST_OUTPUT || of[n] >= COUNT || by[m] < FIRST_INPUT || by[m] >= FIRST_OUTPUT) {
                return 0;
            }
            result[n] += derivative(own, of[n], by[m]) * seed[m];
        }
    }
    return 1;
}
