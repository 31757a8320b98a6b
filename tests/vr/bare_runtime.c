/* An OpenXR runtime without a headset: it has an instance and says, when asked for a head-mounted display, that there is none.
   Monado always finds at least a simulated one. With HEADSET defined there is one that no session comes of: it draws with nothing.
   Declarations as in the OpenXR 1.0 specification and its loader interface. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef int32_t Result;
typedef void (*Function)(void);

enum { OK = 0, UNSUPPORTED = -7, NO_SUCH_HEADSET = -35 };

struct Negotiation {
    int32_t type;
    uint32_t version;
    size_t size;
    uint32_t interface_version;
    uint64_t api_version;
    Result (*get_address)(uint64_t, const char *, Function *);
};

struct Extension {
    int32_t type;
    void *next;
    char name[128];
    uint32_t version;
};

struct InstanceProperties {
    int32_t type;
    void *next;
    uint64_t version;
    char name[128];
};

struct SystemProperties {
    int32_t type;
    void *next;
    uint64_t system;
    uint32_t vendor;
    char name[256];
};

static Result list_extensions(const char *layer, uint32_t capacity, uint32_t *count, struct Extension *extensions) {
    (void)layer;
    *count = 1;
    if (capacity == 0) return OK;
    strcpy(extensions[0].name, "XR_KHR_vulkan_enable2");
    extensions[0].version = 1;
    return OK;
}

static Result create_instance(const void *info, uint64_t *instance) {
    (void)info;
    *instance = 1;
    return OK;
}

static Result destroy_instance(uint64_t instance) {
    (void)instance;
    return OK;
}

static Result get_properties(uint64_t instance, struct InstanceProperties *properties) {
    (void)instance;
    properties->version = 1;
    strcpy(properties->name, "Bare Runtime");
    return OK;
}

static Result get_system(uint64_t instance, const void *info, uint64_t *system) {
    (void)instance, (void)info;
#ifdef HEADSET
    *system = 1;
    return OK;
#else
    (void)system;
    return NO_SUCH_HEADSET;
#endif
}

static Result get_system_properties(uint64_t instance, uint64_t system, struct SystemProperties *properties) {
    (void)instance;
    properties->system = system;
    strcpy(properties->name, "Bare Headset");
    return OK;
}

static Result refuse(void) { return UNSUPPORTED; }

static Result get_address(uint64_t instance, const char *name, Function *function) {
    static const struct {
        const char *name;
        Function function;
    } known[] = {
        {"xrGetInstanceProcAddr", (Function)get_address},
        {"xrEnumerateInstanceExtensionProperties", (Function)list_extensions},
        {"xrCreateInstance", (Function)create_instance},
        {"xrDestroyInstance", (Function)destroy_instance},
        {"xrGetInstanceProperties", (Function)get_properties},
        {"xrGetSystem", (Function)get_system},
        {"xrGetSystemProperties", (Function)get_system_properties},
    };
    (void)instance;
    *function = (Function)refuse;
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcmp(name, known[i].name) == 0) *function = known[i].function;
    return OK;
}

Result xrNegotiateLoaderRuntimeInterface(const void *loader, struct Negotiation *request) {
    (void)loader;
    request->interface_version = 1;
    request->api_version = (uint64_t)1 << 48; /* 1.0.0 */
    request->get_address = get_address;
    return OK;
}
