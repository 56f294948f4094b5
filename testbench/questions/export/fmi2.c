/* The functions of FMI 2.0 for co-simulation (Modelica Association, FMI specification 2.0.4, section 4.2). */
#include "fmi.h"

typedef void *fmi2Component;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;

#ifdef FMI2_FUNCTION_PREFIX
#define JOIN(a, b) a##b
#define JOINED(a, b) JOIN(a, b)
#define FMI(name) JOINED(FMI2_FUNCTION_PREFIX, fmi2##name)
#else
#define FMI(name) fmi2##name
#endif
#define ANSWER(name) SHOWN fmi2Status FMI(name)
#define OK_IF(x) return (x) ? fmi2OK : fmi2Error
/* What no model of this kind has: nothing asked for is right, anything else is an error. */
#define NONE(name, type) \
    ANSWER(name)(fmi2Component c, const fmi2ValueReference *r, size_t n, type *x) \
    { (void)c; (void)r; (void)x; OK_IF(n == 0); }

SHOWN const char *FMI(GetTypesPlatform)(void) { return "default"; }
SHOWN const char *FMI(GetVersion)(void) { return "2.0"; }

SHOWN fmi2Component FMI(Instantiate)(
    fmi2String name, int type, fmi2String guid, fmi2String resources, const void *functions, fmi2Boolean visible,
    fmi2Boolean logging)
{
    Flight *f;
    (void)name; (void)resources; (void)functions; (void)visible; (void)logging;
    if (type != 1 || guid == NULL || strcmp(guid, TOKEN) != 0) return NULL; /* 1: co-simulation */
    f = malloc(sizeof *f);
    if (f != NULL) flight_reset(f);
    return f;
}

SHOWN void FMI(FreeInstance)(fmi2Component c) { free(c); }

ANSWER(SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String *categories)
{ (void)c; (void)on; (void)n; (void)categories; return fmi2OK; }

ANSWER(SetupExperiment)(
    fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real begins, fmi2Boolean has_end, fmi2Real ends)
{ (void)has_tolerance; (void)tolerance; (void)has_end; (void)ends; ((Flight *)c)->begins = begins; return fmi2OK; }

ANSWER(EnterInitializationMode)(fmi2Component c) { (void)c; return fmi2OK; }
ANSWER(ExitInitializationMode)(fmi2Component c) { flight_begin(c); return fmi2OK; }
ANSWER(Terminate)(fmi2Component c) { (void)c; return fmi2OK; }
ANSWER(Reset)(fmi2Component c) { flight_reset(c); return fmi2OK; }

ANSWER(GetReal)(fmi2Component c, const fmi2ValueReference *r, size_t n, fmi2Real *x) { OK_IF(flight_get(c, r, n, x)); }
ANSWER(SetReal)(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Real *x)
{ OK_IF(flight_set(c, r, n, x)); }
NONE(GetInteger, fmi2Integer)
NONE(GetBoolean, fmi2Boolean)
NONE(GetString, fmi2String)
NONE(SetInteger, const fmi2Integer)
NONE(SetBoolean, const fmi2Boolean)
NONE(SetString, const fmi2String)

ANSWER(GetFMUstate)(fmi2Component c, void **state) { OK_IF((*state = flight_copy(c, *state)) != NULL); }
ANSWER(SetFMUstate)(fmi2Component c, void *state) { flight_copy(state, c); return fmi2OK; }
ANSWER(FreeFMUstate)(fmi2Component c, void **state) { (void)c; free(*state); *state = NULL; return fmi2OK; }
ANSWER(SerializedFMUstateSize)(fmi2Component c, void *state, size_t *size)
{ (void)c; (void)state; *size = sizeof(Flight); return fmi2OK; }
ANSWER(SerializeFMUstate)(fmi2Component c, void *state, fmi2Byte *bytes, size_t size)
{ (void)c; if (size != sizeof(Flight)) return fmi2Error; flight_copy(state, bytes); return fmi2OK; }
ANSWER(DeSerializeFMUstate)(fmi2Component c, const fmi2Byte *bytes, size_t size, void **state)
{ (void)c; if (size != sizeof(Flight)) return fmi2Error; OK_IF((*state = flight_copy(bytes, *state)) != NULL); }

ANSWER(GetDirectionalDerivative)(
    fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2ValueReference *s, size_t m, const fmi2Real *x,
    fmi2Real *y)
{ (void)c; (void)r; (void)n; (void)s; (void)m; (void)x; (void)y; return fmi2Error; }
ANSWER(SetRealInputDerivatives)(
    fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Integer *order, const fmi2Real *x)
{ (void)c; (void)r; (void)order; (void)x; OK_IF(n == 0); }
ANSWER(GetRealOutputDerivatives)(
    fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Integer *order, fmi2Real *x)
{ (void)c; (void)r; (void)order; (void)x; OK_IF(n == 0); }

ANSWER(DoStep)(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean no_return)
{ (void)no_return; OK_IF(flight_until(c, now + step)); }
ANSWER(CancelStep)(fmi2Component c) { (void)c; return fmi2Error; }

/* Of steps that go on while others work; there are none. */
ANSWER(GetStatus)(fmi2Component c, int of, fmi2Status *x) { (void)c; (void)of; (void)x; return fmi2Discard; }
ANSWER(GetRealStatus)(fmi2Component c, int of, fmi2Real *x) { (void)c; (void)of; (void)x; return fmi2Discard; }
ANSWER(GetIntegerStatus)(fmi2Component c, int of, fmi2Integer *x) { (void)c; (void)of; (void)x; return fmi2Discard; }
ANSWER(GetBooleanStatus)(fmi2Component c, int of, fmi2Boolean *x) { (void)c; (void)of; (void)x; return fmi2Discard; }
ANSWER(GetStringStatus)(fmi2Component c, int of, fmi2String *x) { (void)c; (void)of; (void)x; return fmi2Discard; }
