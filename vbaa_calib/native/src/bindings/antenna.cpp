#include "numpy.hpp"

namespace vbaa {

void bind_antenna(nb::module_& module) {
    module.def_submodule("antenna", "Shapes of the antenna: elastica, rod, closed forms.");
}

}  // namespace vbaa
