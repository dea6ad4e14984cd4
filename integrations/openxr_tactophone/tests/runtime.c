/* An OpenXR runtime without a device, for test_runtime.py. It accepts a headless
   session, and prints each haptic frame that reaches it in a line. The layouts are
   those of openxr.h 1.1.60, as far as they are used. */
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

typedef int32_t XrResult;
typedef void (*Function)(void);
enum { FUNCTION_UNSUPPORTED = -7, SIZE_INSUFFICIENT = -11, PARAMETRIC = 1000775000 };

typedef struct { int32_t type; void *next; char name[128]; uint32_t version; } Extension;
typedef struct { int64_t time; float value; } Point;
typedef struct {
  int32_t type; const void *next;
  uint32_t amplitude_count; const Point *amplitudes;
  uint32_t frequency_count; const Point *frequencies;
  uint32_t transient_count; const void *transients;
  float lowest, highest; int32_t frame;
} Vibration;
typedef struct { int32_t type; void *next; uint64_t version; char name[128]; } Properties;
typedef XrResult (*Lookup)(uint64_t, const char *, Function *);
typedef struct {
  int32_t type; uint32_t version; size_t size;
  uint32_t lowest, highest; uint64_t lowest_api, highest_api;
} Loader;
typedef struct {
  int32_t type; uint32_t version; size_t size;
  uint32_t interface; uint64_t api; Lookup lookup;
} Runtime;

static uint64_t next_handle = 1;

static XrResult extensions(
    const char *layer, uint32_t capacity, uint32_t *count, Extension *found) {
  const char *names[] = {"XR_MND_headless", "XR_EXT_haptic_parametric"};
  (void)layer;
  *count = 2;
  if (capacity && capacity < 2) return SIZE_INSUFFICIENT;
  for (uint32_t k = 0; k < 2 && capacity; ++k) {
    strcpy(found[k].name, names[k]);
    found[k].version = 1;
  }
  return 0;
}
static XrResult create(const void *info, uint64_t *handle) {
  (void)info;
  *handle = next_handle++;
  return 0;
}
static XrResult create_below(uint64_t parent, const void *info, uint64_t *handle) {
  (void)parent;
  return create(info, handle);
}
static XrResult path(uint64_t instance, const char *text, uint64_t *found) {
  (void)instance; (void)text;
  *found = next_handle++;
  return 0;
}
static XrResult properties(uint64_t instance, Properties *found) {
  (void)instance;
  found->version = 1;
  strcpy(found->name, "a runtime without a device");
  return 0;
}
static XrResult accept(void) { return 0; }
static XrResult apply(uint64_t session, const void *action, const Vibration *frame) {
  (void)session; (void)action;
  if (frame->type != PARAMETRIC) return -1;
  printf("frame %d, %g to %g Hz:", frame->frame, frame->lowest, frame->highest);
  for (uint32_t k = 0; k < frame->amplitude_count; ++k)
    printf(" a(%" PRId64 ")=%.4f", frame->amplitudes[k].time, frame->amplitudes[k].value);
  for (uint32_t k = 0; k < frame->frequency_count; ++k)
    printf(" f(%" PRId64 ")=%.4f", frame->frequencies[k].time, frame->frequencies[k].value);
  printf("\n");
  fflush(stdout);
  return 0;
}

static XrResult lookup(uint64_t instance, const char *name, Function *found) {
  static const struct { const char *name; Function function; } known[] = {
      {"xrEnumerateInstanceExtensionProperties", (Function)extensions},
      {"xrCreateInstance", (Function)create},
      {"xrGetInstanceProperties", (Function)properties},
      {"xrStringToPath", (Function)path},
      {"xrGetSystem", (Function)create_below},
      {"xrCreateSession", (Function)create_below},
      {"xrCreateActionSet", (Function)create_below},
      {"xrCreateAction", (Function)create_below},
      {"xrAttachSessionActionSets", (Function)accept},
      {"xrApplyHapticFeedback", (Function)apply},
      {"xrDestroyAction", (Function)accept},
      {"xrDestroyActionSet", (Function)accept},
      {"xrDestroySession", (Function)accept},
      {"xrDestroyInstance", (Function)accept},
  };
  (void)instance;
  *found = NULL;
  if (!strcmp(name, "xrGetInstanceProcAddr")) *found = (Function)lookup;
  for (size_t k = 0; k < sizeof known / sizeof *known; ++k)
    if (!strcmp(name, known[k].name)) *found = known[k].function;
  return *found ? 0 : FUNCTION_UNSUPPORTED;
}

__attribute__((visibility("default"))) XrResult xrNegotiateLoaderRuntimeInterface(
    const Loader *loader, Runtime *runtime) {
  (void)loader;
  runtime->interface = 1;
  runtime->api = (uint64_t)1 << 48 | (uint64_t)1 << 32;
  runtime->lookup = lookup;
  return 0;
}
