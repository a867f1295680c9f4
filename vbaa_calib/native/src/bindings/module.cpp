// The module that Python imports: a submodule for each room.
#include "numpy.hpp"

namespace nb = nanobind;

NB_MODULE(core, module) {
    nb::set_leak_warnings(false);  // what is cached lives until the interpreter ends
    module.doc() = "Compiled inner loops of vbaa_calib and estimator; arrays are float64 and contiguous.";
    vbaa::bind_lens(module);
    vbaa::bind_bundle(module);
    vbaa::bind_antenna(module);
    vbaa::bind_simulate(module);
    vbaa::bind_solver(module);
    vbaa::bind_search(module);
    vbaa::bind_surface(module);
    vbaa::bind_profile(module);
    vbaa::bind_table(module);
}
