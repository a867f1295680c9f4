// Python's `core.lens.Lens` (what `vbaa_calib.camera.lens.lens_of(intrinsics)` gives) as the core's lens.
#pragma once

#include "lens.hpp"
#include "numpy.hpp"

namespace vbaa {

// Lives as long as the Python object does.
inline const lens::Lens& lens_of(nb::handle object) { return nb::cast<const lens::Lens&>(object); }

}  // namespace vbaa
