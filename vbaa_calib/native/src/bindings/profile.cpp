#include "numpy.hpp"

namespace vbaa {

void bind_profile(nb::module_& module) {
    module.def_submodule("profile", "The antenna in a picture: profiles, reflectance, ends, acceptance.");
}

}  // namespace vbaa
