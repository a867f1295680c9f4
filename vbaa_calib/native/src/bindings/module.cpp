// The module that Python imports: a submodule for each room.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace vbaa {
void bind_lens(nb::module_& module);
void bind_bundle(nb::module_& module);
void bind_antenna(nb::module_& module);
void bind_simulate(nb::module_& module);
void bind_solver(nb::module_& module);
void bind_search(nb::module_& module);
void bind_profile(nb::module_& module);
}  // namespace vbaa

NB_MODULE(core, module) {
    nb::set_leak_warnings(false);  // what is cached lives until the interpreter ends
    module.doc() = "Compiled inner loops of vbaa_calib and estimator; arrays are float64 and contiguous.";
    vbaa::bind_lens(module);
    vbaa::bind_bundle(module);
    vbaa::bind_antenna(module);
    vbaa::bind_simulate(module);
    vbaa::bind_solver(module);
    vbaa::bind_search(module);
    vbaa::bind_profile(module);
}
