/* What units of FMI 2.0 and 3.0 share: one flight of the model, and its variables by their references.

   References count inputs, then outputs, then where the flight begins. Only MODEL(name), N_INPUTS, N_OUTPUTS, DT and
   TOKEN depend on the model. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define N_START 10
#define N_VARIABLES (N_INPUTS + N_OUTPUTS + N_START)

#if defined _WIN32
#define SHOWN __declspec(dllexport)
#elif defined __GNUC__
#define SHOWN __attribute__((visibility("default")))
#else
#define SHOWN
#endif

typedef struct {
    MODEL(state) m;
    double inputs[N_INPUTS], start[N_START];
    double begins; /* s */
    double frames; /* since then; a double counts further than any flight lasts */
} Flight;

static void flight_reset(Flight *f)
{
    memset(f, 0, sizeof *f);
    MODEL(init)(&f->m);
    memcpy(f->inputs, MODEL(trim), sizeof f->inputs);
    memcpy(f->start, START, sizeof f->start);
}

/* Begin: at the trim, or where the parameters say. */
static void flight_begin(Flight *f)
{
    if (memcmp(f->start, START, sizeof f->start) != 0) MODEL(place)(&f->m, f->inputs, f->start);
}

/* Fly up to the frame nearest to a time; return 0 if that lies in the past, or the flight is no longer finite. */
static int flight_until(Flight *f, double time)
{
    const double frames = floor((time - f->begins) / DT + 0.5);
    double outputs[N_OUTPUTS];
    int i;
    if (!(frames >= f->frames)) return 0;
    for (; f->frames < frames; f->frames += 1.0) MODEL(step)(&f->m, f->inputs);
    MODEL(outputs)(&f->m, outputs);
    for (i = 0; i < N_OUTPUTS; i++) if (!isfinite(outputs[i])) return 0;
    return 1;
}

static int flight_get(Flight *f, const unsigned int *references, size_t n, double *values)
{
    double outputs[N_OUTPUTS];
    size_t i;
    MODEL(outputs)(&f->m, outputs);
    for (i = 0; i < n; i++) {
        const unsigned int k = references[i];
        if (k < N_INPUTS) values[i] = f->inputs[k];
        else if (k < N_INPUTS + N_OUTPUTS) values[i] = outputs[k - N_INPUTS];
        else if (k < N_VARIABLES) values[i] = f->start[k - N_INPUTS - N_OUTPUTS];
        else if (k == N_VARIABLES) values[i] = f->begins + f->frames * DT; /* time, which only FMI 3.0 asks for */
        else return 0;
    }
    return 1;
}

static int flight_set(Flight *f, const unsigned int *references, size_t n, const double *values)
{
    size_t i;
    for (i = 0; i < n; i++) {
        const unsigned int k = references[i];
        if (k < N_INPUTS) f->inputs[k] = values[i];
        else if (k >= N_INPUTS + N_OUTPUTS && k < N_VARIABLES) f->start[k - N_INPUTS - N_OUTPUTS] = values[i];
        else return 0;
    }
    return 1;
}

static void *flight_copy(const void *from, void *to)
{
    if (to == NULL) to = malloc(sizeof(Flight));
    return to == NULL ? NULL : memcpy(to, from, sizeof(Flight));
}
