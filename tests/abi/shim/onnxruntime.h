/* Counters and controls of the ONNX Runtime shim in onnxruntime.c. */
#ifndef CAIRN_TEST_ONNXRUNTIME_H
#define CAIRN_TEST_ONNXRUNTIME_H

struct cairn_test_shim {
    /* Number of runs started. */
    unsigned long runs;
    /* Number of session creations started. */
    unsigned long sessions;
    /* Called within each run, on its thread, before it computes; may be null. */
    void (*inside_run)(unsigned long number);
    /* The number of the run that fails; 0 for none. */
    unsigned long fail_run;
    /* Called before every call that may return a status; nonzero makes that call fail. May be null. */
    int (*fails)(void);
};

/* The shim's exports. */
extern const void *OrtGetApiBase(void);
extern struct cairn_test_shim cairn_test_shim;

#endif
