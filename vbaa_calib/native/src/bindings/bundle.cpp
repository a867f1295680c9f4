#include "numpy.hpp"

namespace vbaa {

void bind_bundle(nb::module_& module) {
    module.def_submodule("bundle", "Board corners: robust homographies and bundle adjustment of the lens.");
}

}  // namespace vbaa
