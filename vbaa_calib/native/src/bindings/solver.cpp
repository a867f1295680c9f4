#include "numpy.hpp"

namespace vbaa {

void bind_solver(nb::module_& module) {
    module.def_submodule("solver", "The fit of frames: contacts with uncertainty and other minima.");
}

}  // namespace vbaa
