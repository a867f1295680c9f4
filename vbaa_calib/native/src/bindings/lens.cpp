#include "numpy.hpp"

namespace vbaa {

void bind_lens(nb::module_& module) {
    module.def_submodule("lens", "Pixels and rays of every lens model, with all derivatives.");
}

}  // namespace vbaa
