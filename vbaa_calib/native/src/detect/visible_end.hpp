// Where the antenna ends in a picture, to a fraction of a pixel, and whether that is its tip. Along the line, the
// height of its cross-section drops to nothing over a pixel or two: a blurred step, fitted to the heights. An object in
// front of the antenna makes such a step, too: it is the tip only where nothing but the background is visible behind
// it, and where it is not much nearer than a whole antenna would end.
#pragma once

#include "detect/line_shape.hpp"

namespace vbaa::detect {

using Point = std::array<double, 2>;

enum class EndKind { tip, hidden, border, unsure };

struct VisibleEnd {
    EndKind kind = EndKind::hidden;
    Point place = {NAN, NAN};
    double std_px = NAN;  // along the antenna
};

// What a line looks like: its cross-section, in profiles of 2·half + 1 pixels with this noise, grey levels; −1 where it
// is darker than its background, else 1.
struct Look {
    CrossSection section;
    int half;
    double noise, sign;
    int channel = 0;  // of the picture
};

// The end of a line (K, 2) in a picture, from the clamp to where a whole antenna ends, bridged where it is hidden;
// seen: (K,) where it was measured, somewhere at least.
VisibleEnd visible_end(const Picture& picture, ConstMatrix path_px, const Flags& seen, const Look& look);

// (M, 2) a path (K, 2) on the antenna in points 1 px apart, and on along the line as far as that goes on beyond its
// end: bent towards the camera, it is longer in the picture. Unchanged where more follows than an antenna may be longer
// by.
Table to_its_end(const Picture& picture, ConstMatrix path_px, const Look& look);

}  // namespace vbaa::detect
