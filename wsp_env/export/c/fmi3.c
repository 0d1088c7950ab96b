/* FMI 3.0 for co-simulation; types and functions as the standard has them. */
#include <stdbool.h>

#include "common.c"

typedef void *fmi3Instance;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef const char *fmi3String;
typedef const uint8_t *fmi3Binary;
typedef uint8_t fmi3Byte;
typedef bool fmi3Clock;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;

static const char TOKEN[] = "@token@";

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, bool on, size_t n, const fmi3String categories[])
{
    (void)c; (void)on; (void)n; (void)categories;
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String place, bool visible,
    bool logging, bool events, bool early, const fmi3ValueReference between[], size_t count, void *environment,
    void (*log)(void *, fmi3Status, fmi3String, fmi3String), void (*update)(void))
{
    (void)name; (void)place; (void)visible; (void)logging; (void)early; (void)between; (void)count; (void)environment;
    (void)log; (void)update;
    return events ? NULL : make(token, TOKEN);
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String place, bool visible,
    bool logging, void *environment, void (*log)(void))
{
    (void)name; (void)token; (void)place; (void)visible; (void)logging; (void)environment; (void)log;
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String place, bool visible,
    bool logging, void *environment, void (*log)(void), void (*clock)(void), void (*lock)(void), void (*unlock)(void))
{
    (void)name; (void)token; (void)place; (void)visible; (void)logging; (void)environment; (void)log; (void)clock;
    (void)lock; (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance c) { free(c); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool defined, double tolerance, double start, bool stops,
    double stop)
{
    (void)defined; (void)tolerance; (void)stops; (void)stop;
    ((instance *)c)->time = start;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    initialise(c);
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance c) { (void)c; return fmi3OK; }

EXPORT fmi3Status fmi3Reset(fmi3Instance c)
{
    begin(c);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, double value[], size_t values)
{
    return said(n == values && get_all(c, vr, n, value));
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const double value[], size_t values)
{
    return said(n == values && set_all(c, vr, n, value));
}

/* There are no variables of other types. */
#define NONE(name, type) \
    EXPORT fmi3Status fmi3Get##name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, type value[], size_t values) \
    { \
        (void)c; (void)vr; (void)value; (void)values; \
        return n == 0 ? fmi3OK : fmi3Error; \
    } \
    EXPORT fmi3Status fmi3Set##name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const type value[], size_t values) \
    { \
        (void)c; (void)vr; (void)value; (void)values; \
        return n == 0 ? fmi3OK : fmi3Error; \
    }
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
NONE(String, fmi3String)

EXPORT fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary value[],
    size_t values)
{
    (void)c; (void)vr; (void)sizes; (void)value; (void)values;
    return n == 0 ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
    const fmi3Binary value[], size_t values)
{
    (void)c; (void)vr; (void)sizes; (void)value; (void)values;
    return n == 0 ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) { return said(keep(c, sizeof(instance), state)); }

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    memcpy(c, state, sizeof(instance));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    forget(state);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c; (void)state;
    *size = sizeof(instance);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    (void)c;
    return said(serialise(state, bytes, size));
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    (void)c;
    return said(keep(bytes, size, state));
}

EXPORT fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference of[], size_t outputs,
    const fmi3ValueReference by[], size_t inputs, const double seed[], size_t seeds, double result[], size_t results)
{
    return said(seeds == inputs && results == outputs && sensitivity(c, of, outputs, by, inputs, seed, result));
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance c, double time, double duration, bool keeps, bool *event, bool *terminate,
    bool *early, double *last)
{
    (void)keeps;
    *event = *terminate = *early = false;
    *last = time;
    if (!advance(c, time, duration)) {
        return fmi3Error;
    }
    *last = time + duration;
    return fmi3OK;
}

/* What modelDescription.xml says that this FMU cannot. */
#define CANNOT(name, ...) \
    EXPORT fmi3Status fmi3##name(__VA_ARGS__) \
    { \
        return fmi3Error; \
    }
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#define VR const fmi3ValueReference vr[], size_t n
CANNOT(EnterEventMode, fmi3Instance c)
CANNOT(EnterConfigurationMode, fmi3Instance c)
CANNOT(ExitConfigurationMode, fmi3Instance c)
CANNOT(EnterStepMode, fmi3Instance c)
CANNOT(EnterContinuousTimeMode, fmi3Instance c)
CANNOT(EvaluateDiscreteStates, fmi3Instance c)
CANNOT(GetClock, fmi3Instance c, VR, fmi3Clock value[])
CANNOT(SetClock, fmi3Instance c, VR, const fmi3Clock value[])
CANNOT(GetNumberOfVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t *n)
CANNOT(GetVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t of[], fmi3ValueReference by[], size_t at[],
    int kinds[], size_t n)
CANNOT(GetAdjointDerivative, fmi3Instance c, VR, const fmi3ValueReference by[], size_t m, const double seed[], size_t seeds,
    double result[], size_t results)
CANNOT(GetIntervalDecimal, fmi3Instance c, VR, double intervals[], int qualifiers[])
CANNOT(GetIntervalFraction, fmi3Instance c, VR, uint64_t counters[], uint64_t resolutions[], int qualifiers[])
CANNOT(GetShiftDecimal, fmi3Instance c, VR, double shifts[])
CANNOT(GetShiftFraction, fmi3Instance c, VR, uint64_t counters[], uint64_t resolutions[])
CANNOT(SetIntervalDecimal, fmi3Instance c, VR, const double intervals[])
CANNOT(SetIntervalFraction, fmi3Instance c, VR, const uint64_t counters[], const uint64_t resolutions[])
CANNOT(SetShiftDecimal, fmi3Instance c, VR, const double shifts[])
CANNOT(SetShiftFraction, fmi3Instance c, VR, const uint64_t counters[], const uint64_t resolutions[])
CANNOT(UpdateDiscreteStates, fmi3Instance c, bool *update, bool *terminate, bool *nominals, bool *values, bool *defined,
    double *next)
CANNOT(CompletedIntegratorStep, fmi3Instance c, bool keeps, bool *event, bool *terminate)
CANNOT(SetTime, fmi3Instance c, double time)
CANNOT(SetContinuousStates, fmi3Instance c, const double states[], size_t n)
CANNOT(GetContinuousStateDerivatives, fmi3Instance c, double derivatives[], size_t n)
CANNOT(GetEventIndicators, fmi3Instance c, double indicators[], size_t n)
CANNOT(GetContinuousStates, fmi3Instance c, double states[], size_t n)
CANNOT(GetNominalsOfContinuousStates, fmi3Instance c, double nominals[], size_t n)
CANNOT(GetNumberOfEventIndicators, fmi3Instance c, size_t *n)
CANNOT(GetNumberOfContinuousStates, fmi3Instance c, size_t *n)
CANNOT(GetOutputDerivatives, fmi3Instance c, VR, const int32_t orders[], double values[], size_t count)
CANNOT(ActivateModelPartition, fmi3Instance c, fmi3ValueReference clock, double time)
