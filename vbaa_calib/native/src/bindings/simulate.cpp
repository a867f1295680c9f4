#include "numpy.hpp"

namespace vbaa {

void bind_simulate(nb::module_& module) {
    module.def_submodule("simulate", "The simulator's rods and pictures; shares nothing with what it tests.");
}

}  // namespace vbaa
