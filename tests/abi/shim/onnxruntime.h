/* What a test sees of the ONNX Runtime in onnxruntime.c, and the controls it has over it. */
#ifndef CAIRN_TEST_ONNXRUNTIME_H
#define CAIRN_TEST_ONNXRUNTIME_H

struct cairn_test_shim {
    /* Runs begun. */
    unsigned long runs;
    /* Sessions begun to be made. */
    unsigned long sessions;
    /* Called within each run, on its thread, before it computes; may be null. */
    void (*inside_run)(unsigned long number);
    /* The number of the run that fails; 0 for none. */
    unsigned long fail_run;
    /* Asked before every call that may answer with a status, whether it fails instead; may be null. */
    int (*fails)(void);
};

/* The shim exports one of these. */
extern const void *OrtGetApiBase(void);
extern struct cairn_test_shim cairn_test_shim;

#endif
