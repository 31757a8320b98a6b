/* An OpenXR layer that takes the focus away, as a runtime does whose own menu is open: while the file that INCISE_FOCUS_AWAY names is
   there, the session is VISIBLE and not FOCUSED, and xrSyncActions answers XR_SESSION_NOT_FOCUSED. What the actions said last they go
   on saying, so a program that listens nevertheless is found out. Monado takes the focus only together with the picture (its
   system_set_focused_client is unimplemented). Declarations as in the OpenXR 1.0 specification and its loader interface. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef int32_t Result;
typedef void (*Function)(void);
typedef uint64_t Handle;
typedef Result (*GetAddress)(Handle, const char *, Function *);

enum { OK = 0, EVENT_UNAVAILABLE = 4, SESSION_NOT_FOCUSED = 8, STATE_CHANGED = 18, VISIBLE = 4, FOCUSED = 5 };

struct Event {
    int32_t type;
    const void *next;
    Handle session;
    int32_t state;
    int64_t time;
};

struct NextLayer {
    int32_t type;
    uint32_t version;
    size_t size;
    char name[256];
    GetAddress get_address;
    Result (*create_instance)(const void *, const void *, Handle *);
    const struct NextLayer *next;
};

struct LayerInfo {
    int32_t type;
    uint32_t version;
    size_t size;
    void *loader;
    char settings[512];
    const struct NextLayer *next;
};

struct Negotiation {
    int32_t type;
    uint32_t version;
    size_t size;
    uint32_t interface_version;
    uint64_t api_version;
    GetAddress get_address;
    Result (*create_instance)(const void *, const struct LayerInfo *, Handle *);
};

static GetAddress next_address;
static Result (*next_poll)(Handle, void *);
static Result (*next_sync)(Handle, const void *);
/* What the runtime said last, and whether the program was told otherwise. */
static struct Event last;
static int away;

static int wanted_away(void) {
    const char *file = getenv("INCISE_FOCUS_AWAY");
    return file && access(file, F_OK) == 0;
}

static Result poll_event(Handle instance, struct Event *event) {
    int go = last.state == FOCUSED && wanted_away();
    if (go != away) {
        away = go;
        *event = last;
        event->next = NULL;
        event->state = go ? VISIBLE : FOCUSED;
        /* A runtime that has gone on to another state says so itself. */
        if (go || last.state == FOCUSED) return OK;
    }
    Result result = next_poll(instance, event);
    if (result == OK && event->type == STATE_CHANGED) last = *event;
    return result;
}

static Result sync_actions(Handle session, const void *info) { return away ? SESSION_NOT_FOCUSED : next_sync(session, info); }

static Result get_address(Handle instance, const char *name, Function *function) {
    Result result = next_address(instance, name, function);
    if (result != OK) return result;
    if (strcmp(name, "xrPollEvent") == 0) {
        next_poll = (Result(*)(Handle, void *))*function;
        *function = (Function)poll_event;
    } else if (strcmp(name, "xrSyncActions") == 0) {
        next_sync = (Result(*)(Handle, const void *))*function;
        *function = (Function)sync_actions;
    }
    return OK;
}

static Result create_instance(const void *info, const struct LayerInfo *layer, Handle *instance) {
    struct LayerInfo below = *layer;
    below.next = layer->next->next;
    Result result = layer->next->create_instance(info, &below, instance);
    next_address = layer->next->get_address;
    return result;
}

__attribute__((visibility("default"))) Result xrNegotiateLoaderApiLayerInterface(const void *loader, const char *name,
                                                                                 struct Negotiation *request) {
    (void)loader, (void)name;
    request->interface_version = 1;
    request->api_version = (uint64_t)1 << 48; /* 1.0.0 */
    request->get_address = get_address;
    request->create_instance = create_instance;
    return OK;
}
