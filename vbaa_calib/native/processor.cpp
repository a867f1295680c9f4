// Which build of the core this processor runs. Without nanobind, and without any of the core's flags: it runs first.
#include <Python.h>

#include "processor.hpp"

namespace {

PyModuleDef definition = {PyModuleDef_HEAD_INIT, "processor", nullptr, -1, nullptr, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit_processor() {
    PyObject* module = PyModule_Create(&definition);
    if (module != nullptr && PyModule_AddStringConstant(module, "LEVEL", vbaa::level()) != 0) {
        Py_DECREF(module);
        return nullptr;
    }
    return module;
}
