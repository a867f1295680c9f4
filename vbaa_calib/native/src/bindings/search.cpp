#include "numpy.hpp"

namespace vbaa {

void bind_search(nb::module_& module) {
    module.def_submodule("search", "The antenna in a picture: corridor, paths, lines.");
}

}  // namespace vbaa
