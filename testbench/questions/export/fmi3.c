/* The functions of FMI 3.0 for co-simulation (Modelica Association, FMI specification 3.0.2, chapter 4). */
#include <stdbool.h>
#include <stdint.h>
#include "fmi.h"

typedef void *fmi3Instance;
typedef unsigned int fmi3ValueReference;
typedef const char *fmi3String;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;

#ifdef FMI3_FUNCTION_PREFIX
#define JOIN(a, b) a##b
#define JOINED(a, b) JOIN(a, b)
#define FMI(name) JOINED(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define FMI(name) fmi3##name
#endif
#define ANSWER(name) SHOWN fmi3Status FMI(name)
#define OK_IF(x) return (x) ? fmi3OK : fmi3Error
/* What no model of this kind has: nothing asked for is right, anything else is an error. */
#define NONE(kind, type) \
    ANSWER(Get##kind)(fmi3Instance i, const fmi3ValueReference *r, size_t n, type *x, size_t m) \
    { (void)i; (void)r; (void)x; (void)m; OK_IF(n == 0); } \
    ANSWER(Set##kind)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const type *x, size_t m) \
    { (void)i; (void)r; (void)x; (void)m; OK_IF(n == 0); }

SHOWN const char *FMI(GetVersion)(void) { return "3.0"; }

SHOWN fmi3Instance FMI(InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging, bool events, bool early_return,
    const fmi3ValueReference *required, size_t n, void *environment, void *log, void *update)
{
    Flight *f;
    (void)name; (void)resources; (void)visible; (void)logging; (void)early_return; (void)required; (void)n;
    (void)environment; (void)log; (void)update;
    if (events || token == NULL || strcmp(token, TOKEN) != 0) return NULL;
    f = malloc(sizeof *f);
    if (f != NULL) flight_reset(f);
    return f;
}

SHOWN fmi3Instance FMI(InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging, void *environment, void *log)
{ (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log; return NULL; }
SHOWN fmi3Instance FMI(InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging, void *environment, void *log,
    void *update, void *lock, void *unlock)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log; (void)update;
    (void)lock; (void)unlock;
    return NULL;
}
SHOWN void FMI(FreeInstance)(fmi3Instance i) { free(i); }

ANSWER(SetDebugLogging)(fmi3Instance i, bool on, size_t n, const fmi3String *categories)
{ (void)i; (void)on; (void)n; (void)categories; return fmi3OK; }
ANSWER(EnterInitializationMode)(
    fmi3Instance i, bool has_tolerance, double tolerance, double begins, bool has_end, double ends)
{ (void)has_tolerance; (void)tolerance; (void)has_end; (void)ends; ((Flight *)i)->begins = begins; return fmi3OK; }
ANSWER(ExitInitializationMode)(fmi3Instance i) { flight_begin(i); return fmi3OK; }
ANSWER(Terminate)(fmi3Instance i) { (void)i; return fmi3OK; }
ANSWER(Reset)(fmi3Instance i) { flight_reset(i); return fmi3OK; }

ANSWER(GetFloat64)(fmi3Instance i, const fmi3ValueReference *r, size_t n, double *x, size_t m)
{ OK_IF(m == n && flight_get(i, r, n, x)); }
ANSWER(SetFloat64)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const double *x, size_t m)
{ OK_IF(m == n && flight_set(i, r, n, x)); }
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
ANSWER(GetBinary)(
    fmi3Instance i, const fmi3ValueReference *r, size_t n, size_t *sizes, const uint8_t **x, size_t m)
{ (void)i; (void)r; (void)sizes; (void)x; (void)m; OK_IF(n == 0); }
ANSWER(SetBinary)(
    fmi3Instance i, const fmi3ValueReference *r, size_t n, const size_t *sizes, const uint8_t *const *x, size_t m)
{ (void)i; (void)r; (void)sizes; (void)x; (void)m; OK_IF(n == 0); }
ANSWER(GetClock)(fmi3Instance i, const fmi3ValueReference *r, size_t n, bool *x)
{ (void)i; (void)r; (void)x; OK_IF(n == 0); }
ANSWER(SetClock)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const bool *x)
{ (void)i; (void)r; (void)x; OK_IF(n == 0); }

ANSWER(GetFMUState)(fmi3Instance i, void **state) { OK_IF((*state = flight_copy(i, *state)) != NULL); }
ANSWER(SetFMUState)(fmi3Instance i, void *state) { flight_copy(state, i); return fmi3OK; }
ANSWER(FreeFMUState)(fmi3Instance i, void **state) { (void)i; free(*state); *state = NULL; return fmi3OK; }
ANSWER(SerializedFMUStateSize)(fmi3Instance i, void *state, size_t *size)
{ (void)i; (void)state; *size = sizeof(Flight); return fmi3OK; }
ANSWER(SerializeFMUState)(fmi3Instance i, void *state, uint8_t *bytes, size_t size)
{ (void)i; if (size != sizeof(Flight)) return fmi3Error; flight_copy(state, bytes); return fmi3OK; }
ANSWER(DeserializeFMUState)(fmi3Instance i, const uint8_t *bytes, size_t size, void **state)
{ (void)i; if (size != sizeof(Flight)) return fmi3Error; OK_IF((*state = flight_copy(bytes, *state)) != NULL); }

ANSWER(DoStep)(
    fmi3Instance i, double now, double step, bool no_return, bool *event, bool *ended, bool *early, double *last)
{
    const int flown = flight_until(i, now + step);
    (void)no_return;
    *event = *ended = *early = false;
    *last = now + step;
    OK_IF(flown);
}

ANSWER(EnterConfigurationMode)(fmi3Instance i) { (void)i; return fmi3OK; }
ANSWER(ExitConfigurationMode)(fmi3Instance i) { (void)i; return fmi3OK; }
ANSWER(EnterEventMode)(fmi3Instance i) { (void)i; return fmi3Error; }
ANSWER(EnterStepMode)(fmi3Instance i) { (void)i; return fmi3Error; }
ANSWER(EnterContinuousTimeMode)(fmi3Instance i) { (void)i; return fmi3Error; }
ANSWER(EvaluateDiscreteStates)(fmi3Instance i) { (void)i; return fmi3Error; }

/* Of events, clocks, continuous states and derivatives, which a flight in frames has not. */
ANSWER(UpdateDiscreteStates)(fmi3Instance i, bool *a, bool *b, bool *c, bool *d, bool *e, double *x)
{ (void)i; (void)a; (void)b; (void)c; (void)d; (void)e; (void)x; return fmi3Error; }
ANSWER(GetNumberOfVariableDependencies)(fmi3Instance i, fmi3ValueReference r, size_t *n)
{ (void)i; (void)r; (void)n; return fmi3Error; }
ANSWER(GetVariableDependencies)(fmi3Instance i, fmi3ValueReference r, size_t *a, fmi3ValueReference *b, size_t *c,
    int *d, size_t n)
{ (void)i; (void)r; (void)a; (void)b; (void)c; (void)d; (void)n; return fmi3Error; }
ANSWER(GetDirectionalDerivative)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const fmi3ValueReference *s,
    size_t m, const double *x, size_t k, double *y, size_t l)
{ (void)i; (void)r; (void)n; (void)s; (void)m; (void)x; (void)k; (void)y; (void)l; return fmi3Error; }
ANSWER(GetAdjointDerivative)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const fmi3ValueReference *s,
    size_t m, const double *x, size_t k, double *y, size_t l)
{ (void)i; (void)r; (void)n; (void)s; (void)m; (void)x; (void)k; (void)y; (void)l; return fmi3Error; }
ANSWER(GetIntervalDecimal)(fmi3Instance i, const fmi3ValueReference *r, size_t n, double *x, int *y)
{ (void)i; (void)r; (void)n; (void)x; (void)y; return fmi3Error; }
ANSWER(GetIntervalFraction)(fmi3Instance i, const fmi3ValueReference *r, size_t n, uint64_t *x, uint64_t *y, int *z)
{ (void)i; (void)r; (void)n; (void)x; (void)y; (void)z; return fmi3Error; }
ANSWER(GetShiftDecimal)(fmi3Instance i, const fmi3ValueReference *r, size_t n, double *x)
{ (void)i; (void)r; (void)n; (void)x; return fmi3Error; }
ANSWER(GetShiftFraction)(fmi3Instance i, const fmi3ValueReference *r, size_t n, uint64_t *x, uint64_t *y)
{ (void)i; (void)r; (void)n; (void)x; (void)y; return fmi3Error; }
ANSWER(SetIntervalDecimal)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const double *x)
{ (void)i; (void)r; (void)n; (void)x; return fmi3Error; }
ANSWER(SetIntervalFraction)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const uint64_t *x, const uint64_t
    *y)
{ (void)i; (void)r; (void)n; (void)x; (void)y; return fmi3Error; }
ANSWER(SetShiftDecimal)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const double *x)
{ (void)i; (void)r; (void)n; (void)x; return fmi3Error; }
ANSWER(SetShiftFraction)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const uint64_t *x, const uint64_t *y)
{ (void)i; (void)r; (void)n; (void)x; (void)y; return fmi3Error; }
ANSWER(CompletedIntegratorStep)(fmi3Instance i, bool a, bool *b, bool *c)
{ (void)i; (void)a; (void)b; (void)c; return fmi3Error; }
ANSWER(SetTime)(fmi3Instance i, double x)
{ (void)i; (void)x; return fmi3Error; }
ANSWER(SetContinuousStates)(fmi3Instance i, const double *x, size_t n)
{ (void)i; (void)x; (void)n; return fmi3Error; }
ANSWER(GetContinuousStateDerivatives)(fmi3Instance i, double *x, size_t n)
{ (void)i; (void)x; (void)n; return fmi3Error; }
ANSWER(GetEventIndicators)(fmi3Instance i, double *x, size_t n)
{ (void)i; (void)x; (void)n; return fmi3Error; }
ANSWER(GetContinuousStates)(fmi3Instance i, double *x, size_t n)
{ (void)i; (void)x; (void)n; return fmi3Error; }
ANSWER(GetNominalsOfContinuousStates)(fmi3Instance i, double *x, size_t n)
{ (void)i; (void)x; (void)n; return fmi3Error; }
ANSWER(GetNumberOfEventIndicators)(fmi3Instance i, size_t *n)
{ (void)i; (void)n; return fmi3Error; }
ANSWER(GetNumberOfContinuousStates)(fmi3Instance i, size_t *n)
{ (void)i; (void)n; return fmi3Error; }
ANSWER(GetOutputDerivatives)(fmi3Instance i, const fmi3ValueReference *r, size_t n, const int32_t *o, double *x,
    size_t m)
{ (void)i; (void)r; (void)n; (void)o; (void)x; (void)m; return fmi3Error; }
ANSWER(ActivateModelPartition)(fmi3Instance i, fmi3ValueReference r, double x)
{ (void)i; (void)r; (void)x; return fmi3Error; }
