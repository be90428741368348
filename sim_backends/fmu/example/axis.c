/* A motor axis as a functional mock-up unit for co-simulation; FMI_VERSION is 2 or 3.

   The voltage drives it; angle and speed come out. With `friction`, `drag` and `offset` at zero it has viscous
   damping only. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#if FMI_VERSION == 3
#include "fmi3FunctionTypes.h"
#else
#include "fmi2FunctionTypes.h"
#endif

#define TOKEN "{a4a1c5f2-3c0e-4c7e-9a39-5d0c54a1a0f1}"
#define INNER_STEP_S 0.002
#define BURST_SPEED 1000.0 /* rad/s */

/* Value references, as in the model description. */
enum {
    TIME, VOLTAGE, ANGLE, SPEED, TORQUE_PER_VOLT, DAMPING, INERTIA, FRICTION, FRICTION_SPEED, DRAG, OFFSET,
    FIRST_ANGLE, FIRST_SPEED, COUNT
};

static const double START[COUNT] = {
    [TORQUE_PER_VOLT] = 0.085, [DAMPING] = 0.02, [INERTIA] = 0.005, [FRICTION_SPEED] = 0.1,
};

typedef struct {
    double value[COUNT];
} Axis;

static double acceleration(const double *value, double speed)
{
    double torque = value[TORQUE_PER_VOLT] * value[VOLTAGE] - value[DAMPING] * speed + value[OFFSET];
    torque -= value[FRICTION] * tanh(speed / value[FRICTION_SPEED]) + value[DRAG] * speed * fabs(speed);
    return torque / value[INERTIA];
}

/* Runge and Kutta's method of fourth order. */
static void step(double *value, double h)
{
    double v1 = value[SPEED], a1 = acceleration(value, v1);
    double v2 = v1 + 0.5 * h * a1, a2 = acceleration(value, v2);
    double v3 = v1 + 0.5 * h * a2, a3 = acceleration(value, v3);
    double v4 = v1 + h * a3, a4 = acceleration(value, v4);
    value[ANGLE] += h * (v1 + 2.0 * v2 + 2.0 * v3 + v4) / 6.0;
    value[SPEED] += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0;
    value[TIME] += h;
}

/* Return 0 where the axis bursts. */
static int advance(Axis *axis, double duration)
{
    int count = (int)ceil(duration / INNER_STEP_S - 1e-9);
    for (int i = 0; i < count; i++) {
        step(axis->value, duration / count);
        if (fabs(axis->value[SPEED]) > BURST_SPEED) return 0;
    }
    return 1;
}

static void begin(Axis *axis)
{
    axis->value[ANGLE] = axis->value[FIRST_ANGLE];
    axis->value[SPEED] = axis->value[FIRST_SPEED];
}

static void *make(const char *token)
{
    Axis *axis = strcmp(token, TOKEN) ? NULL : calloc(1, sizeof(Axis));
    if (axis) memcpy(axis->value, START, sizeof START);
    return axis;
}

static void read_values(const void *axis, const unsigned *references, size_t count, double *values)
{
    for (size_t i = 0; i < count; i++) values[i] = ((const Axis *)axis)->value[references[i]];
}

static void write_values(void *axis, const unsigned *references, size_t count, const double *values)
{
    for (size_t i = 0; i < count; i++) ((Axis *)axis)->value[references[i]] = values[i];
}

/* The standard requires every function to exist; these are not supported by this unit. */
#define MISSING(name) int name(void) { return 3; }

#if FMI_VERSION == 3

MISSING(fmi3SetDebugLogging) MISSING(fmi3EnterEventMode) MISSING(fmi3GetFloat32) MISSING(fmi3GetInt8)
MISSING(fmi3GetUInt8) MISSING(fmi3GetInt16) MISSING(fmi3GetUInt16) MISSING(fmi3GetInt32)
MISSING(fmi3GetUInt32) MISSING(fmi3GetInt64) MISSING(fmi3GetUInt64) MISSING(fmi3GetBoolean)
MISSING(fmi3GetString) MISSING(fmi3GetBinary) MISSING(fmi3GetClock) MISSING(fmi3SetFloat32)
MISSING(fmi3SetInt8) MISSING(fmi3SetUInt8) MISSING(fmi3SetInt16) MISSING(fmi3SetUInt16)
MISSING(fmi3SetInt32) MISSING(fmi3SetUInt32) MISSING(fmi3SetInt64) MISSING(fmi3SetUInt64)
MISSING(fmi3SetBoolean) MISSING(fmi3SetString) MISSING(fmi3SetBinary) MISSING(fmi3SetClock)
MISSING(fmi3GetNumberOfVariableDependencies) MISSING(fmi3GetVariableDependencies) MISSING(fmi3GetFMUState)
MISSING(fmi3SetFMUState) MISSING(fmi3FreeFMUState) MISSING(fmi3SerializedFMUStateSize)
MISSING(fmi3SerializeFMUState) MISSING(fmi3DeserializeFMUState) MISSING(fmi3GetDirectionalDerivative)
MISSING(fmi3GetAdjointDerivative) MISSING(fmi3EnterConfigurationMode) MISSING(fmi3ExitConfigurationMode)
MISSING(fmi3GetIntervalDecimal) MISSING(fmi3GetIntervalFraction) MISSING(fmi3GetShiftDecimal)
MISSING(fmi3GetShiftFraction) MISSING(fmi3SetIntervalDecimal) MISSING(fmi3SetIntervalFraction)
MISSING(fmi3SetShiftDecimal) MISSING(fmi3SetShiftFraction) MISSING(fmi3EvaluateDiscreteStates)
MISSING(fmi3UpdateDiscreteStates) MISSING(fmi3EnterContinuousTimeMode) MISSING(fmi3CompletedIntegratorStep)
MISSING(fmi3SetTime) MISSING(fmi3SetContinuousStates) MISSING(fmi3GetContinuousStateDerivatives)
MISSING(fmi3GetEventIndicators) MISSING(fmi3GetContinuousStates) MISSING(fmi3GetNominalsOfContinuousStates)
MISSING(fmi3GetNumberOfEventIndicators) MISSING(fmi3GetNumberOfContinuousStates) MISSING(fmi3EnterStepMode)
MISSING(fmi3GetOutputDerivatives) MISSING(fmi3ActivateModelPartition)
MISSING(fmi3InstantiateModelExchange) MISSING(fmi3InstantiateScheduledExecution)

const char *fmi3GetVersion(void) { return "3.0"; }

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early_return, const fmi3ValueReference required[], size_t required_count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    return make(token);
}

void fmi3FreeInstance(fmi3Instance axis) { free(axis); }

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance axis, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean has_stop, fmi3Float64 stop)
{
    ((Axis *)axis)->value[TIME] = start;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance axis)
{
    begin(axis);
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance axis) { return fmi3OK; }

fmi3Status fmi3Reset(fmi3Instance axis)
{
    memcpy(((Axis *)axis)->value, START, sizeof START);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(
    fmi3Instance axis, const fmi3ValueReference references[], size_t count, fmi3Float64 values[], size_t size)
{
    read_values(axis, references, count, values);
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(
    fmi3Instance axis, const fmi3ValueReference references[], size_t count, const fmi3Float64 values[],
    size_t size)
{
    write_values(axis, references, count, values);
    return fmi3OK;
}

fmi3Status fmi3DoStep(
    fmi3Instance axis, fmi3Float64 now, fmi3Float64 duration, fmi3Boolean keep, fmi3Boolean *event,
    fmi3Boolean *is_over, fmi3Boolean *early, fmi3Float64 *reached)
{
    int is_sound = advance(axis, duration);
    *event = *early = fmi3False;
    *is_over = is_sound ? fmi3False : fmi3True;
    *reached = ((Axis *)axis)->value[TIME];
    return fmi3OK;
}

#else

MISSING(fmi2SetDebugLogging) MISSING(fmi2GetInteger) MISSING(fmi2GetBoolean) MISSING(fmi2GetString)
MISSING(fmi2SetInteger) MISSING(fmi2SetBoolean) MISSING(fmi2SetString) MISSING(fmi2GetFMUstate)
MISSING(fmi2SetFMUstate) MISSING(fmi2FreeFMUstate) MISSING(fmi2SerializedFMUstateSize)
MISSING(fmi2SerializeFMUstate) MISSING(fmi2DeSerializeFMUstate) MISSING(fmi2GetDirectionalDerivative)
MISSING(fmi2SetRealInputDerivatives) MISSING(fmi2GetRealOutputDerivatives) MISSING(fmi2CancelStep)
MISSING(fmi2GetStatus) MISSING(fmi2GetRealStatus) MISSING(fmi2GetIntegerStatus)
MISSING(fmi2GetBooleanStatus) MISSING(fmi2GetStringStatus)

const char *fmi2GetVersion(void) { return "2.0"; }

const char *fmi2GetTypesPlatform(void) { return "default"; }

fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
    const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    return make(token);
}

void fmi2FreeInstance(fmi2Component axis) { free(axis); }

fmi2Status fmi2SetupExperiment(
    fmi2Component axis, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop,
    fmi2Real stop)
{
    ((Axis *)axis)->value[TIME] = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component axis) { return fmi2OK; }

fmi2Status fmi2ExitInitializationMode(fmi2Component axis)
{
    begin(axis);
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component axis) { return fmi2OK; }

fmi2Status fmi2Reset(fmi2Component axis)
{
    memcpy(((Axis *)axis)->value, START, sizeof START);
    return fmi2OK;
}

fmi2Status fmi2GetReal(
    fmi2Component axis, const fmi2ValueReference references[], size_t count, fmi2Real values[])
{
    read_values(axis, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2SetReal(
    fmi2Component axis, const fmi2ValueReference references[], size_t count, const fmi2Real values[])
{
    write_values(axis, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component axis, fmi2Real now, fmi2Real duration, fmi2Boolean keep)
{
    return advance(axis, duration) ? fmi2OK : fmi2Discard;
}

#endif
