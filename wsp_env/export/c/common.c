/* An instance of @name@ for FMI, the same for every version: memory, variables by number, states, steps. */
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
#define CLOCK @clock@ /* number of the time, where it is a variable */

typedef struct {
    @name@ self;
    @name@_parameters p;
    @name@_input u;
    @name@_output y;
    double time;
    int initialised;
    int old; /* the outputs do not belong to the inputs */
} instance;

/* Numbers count parameters, inputs, outputs. Not "number < FIRST_INPUT": a unit may have no parameters, nothing is below 0. */
static int is_parameter(unsigned number) { return number + 1 <= FIRST_INPUT; }
static int is_input(unsigned number) { return number < FIRST_OUTPUT && !is_parameter(number); }

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

/* A new instance; NULL where the description belongs to another binary. */
static instance *make(const char *token, const char *own_token)
{
    instance *own = token != NULL && strcmp(token, own_token) == 0 ? malloc(sizeof *own) : NULL;
    if (own != NULL) {
        begin(own);
    }
    return own;
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
    if (number >= FIRST_OUTPUT || (is_parameter(number) && own->initialised)) {
        return 0;
    }
    *variable(own, number) = value;
    own->old = 1;
    return 1;
}

static int get(instance *own, unsigned number, double *value)
{
    if (number == CLOCK) {
        *value = own->time;
        return 1;
    }
    if (number >= COUNT) {
        return 0;
    }
    if (INTERVAL == 0.0 && own->old && own->initialised && number >= FIRST_OUTPUT) {
        evaluate(own);
    }
    *value = *variable(own, number);
    return 1;
}

/* FMI's status: OK, or error. */
static int said(int done)
{
    return done ? 0 : 3;
}

static int set_all(instance *own, const unsigned number[], size_t n, const double value[])
{
    size_t i;
    for (i = 0; i < n; i++) {
        if (!set(own, number[i], value[i])) {
            return 0;
        }
    }
    return 1;
}

static int get_all(instance *own, const unsigned number[], size_t n, double value[])
{
    size_t i;
    for (i = 0; i < n; i++) {
        if (!get(own, number[i], &value[i])) {
            return 0;
        }
    }
    return 1;
}

/* Copy an instance, or the bytes of one, into a state, which is made where there is none yet. */
static int keep(const void *bytes, size_t size, void **state)
{
    if (size != sizeof(instance)) {
        return 0;
    }
    if (*state == NULL) {
        *state = malloc(sizeof(instance));
    }
    if (*state == NULL) {
        return 0;
    }
    memcpy(*state, bytes, sizeof(instance));
    return 1;
}

static int serialise(const void *state, void *bytes, size_t size)
{
    if (size < sizeof(instance)) {
        return 0;
    }
    memcpy(bytes, state, sizeof(instance));
    return 1;
}

static void forget(void **state)
{
    free(*state);
    *state = NULL;
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
            if (of[n] < FIRST_OUTPUT || of[n] >= COUNT || !is_input(by[m])) {
                return 0;
            }
            result[n] += derivative(own, of[n], by[m]) * seed[m];
        }
    }
    return 1;
}
