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

// Appearance of a line: its cross-section, in profiles of 2·half + 1 pixels with this noise, grey levels; −1 where it
// is darker than its background, else 1.
struct Look {
    CrossSection section;
    int half;
    double noise, sign;
    int channel = 0;  // of the picture
};

// The end of a line (K, 2) in a picture, from the clamp to where a whole antenna ends, bridged where it is hidden;
// seen: (K,) mask of the measured points, not all false.
VisibleEnd visible_end(const Picture& picture, ConstMatrix path_px, const Flags& seen, const Look& look);

// (M, 2) a path (K, 2) on the antenna in points 1 px apart, extended along the line beyond its end: an antenna bent
// towards the camera is longer in the picture. Unchanged where the line goes on further than an antenna can.
Table to_its_end(const Picture& picture, ConstMatrix path_px, const Look& look);

}  // namespace vbaa::detect
