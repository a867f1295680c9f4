// The antenna's cross-section as a picture shows it (paint, light, focus, motion), learned from its own profiles: a
// function of the distance from the centreline in cubic splines, symmetric (asymmetric ones are in ribbon.hpp). With it
// every profile is a least-squares problem in four unknowns: level and slope of the background, height and place.
#pragma once

#include "detect/crossings.hpp"
#include "detect/selection.hpp"

namespace vbaa::detect {

constexpr int PER_PX = 16;              // rows of a tabled shape per pixel
constexpr double PIXEL_BLUR_PX = 0.29;  // a pixel's own square, as a standard deviation
constexpr double MAX_TAPER = 0.6;       // part by which the line may be broader at one end than at the other
constexpr double DISTURBED_RMS = 1.8;   // residuals over the noise from which a profile shows something else, too
constexpr double TAPER_STD = 0.3;       // its prior standard deviation, against fitting noise

// The profile of a line: a tabled function of the distance from the centre, of height one, `PER_PX` rows a pixel, the
// middle row at 0 px.
struct CrossSection {
    Table values;  // (2R + 1, 1)
    Table slopes;  // (2R + 1, 1) derivatives per px
};

// A place in tables of 2R + 1 rows, at a distance from their middle, px: the row before it, and the part of the way on.
struct Place {
    int row;
    double far;

    Place(double across, int last) {
        const double place = bounded(across * PER_PX + 0.5 * last, 0.0, last);
        row = std::min(static_cast<int>(place), last - 1);
        far = place - row;
    }
};

// (2R + 1, C) derivatives per px of functions tabled in `PER_PX` rows a pixel.
Table slopes_of(const Table& values);

// (R, 1) of a table (R, M) and coefficients (M,).
Table product(const Table& table, ConstVector coefficients);

// A round, evenly painted antenna of this width, seen through this blur and the pixel's own square.
CrossSection expected(double width_px, double blur_px, int reach_px);

// Half the width at half the height of a cross-section.
double half_width_px(const CrossSection& section);

// Candidate shapes and spline tables from which a cross-section of one reach is learned.
struct Shapes {
    int reach_px;
    double blur_px;                     // of a lens in focus, standard deviation
    Table bins, values, slopes;         // (B, M), (R, M), (R, M) even cubic splines in bins and, with slopes, in rows
    CrossSection ordinary;              // the antenna in focus
    std::vector<CrossSection> blurred;  // somewhat thinner and broader antennas, from sharp to far out of focus
};

// The `Shapes` for an antenna of this width and, in focus, this blur, up to `reach_px` on either side.
Shapes shapes(double width_px, double blur_px, int reach_px);

// Heights by distance from the centre: how many (B,) and their means (B,).
struct Binned {
    Numbers number, mean;
};

// Heights (N, T) of the chosen profiles by their distances from centres (N,).
Binned binned(const Crossings& found, ConstVector centre, const Table& heights, const Flags& chosen, int reach_px);

// Root mean square difference of the line's two sides, beyond the contribution of `noise` of one height.
double lopsided(const Binned& seen, double noise);

// The shape that an antenna of about this width has at the blur that the heights show.
CrossSection nearest(const Binned& seen, const Shapes& known);

// The smooth symmetric shape fitted to the heights, of any form.
CrossSection learn(const Binned& seen, const Shapes& known);

// Lines fitted to N profiles of T pixels, padded to whole lanes: numbers beyond the pixels have no meaning.
struct Fits {
    Numbers shift;         // (N,) how far the line lies from the assumed centre along the profile, px
    Numbers height;        // (N,) grey levels
    Numbers unit_height;   // (N,) the height's standard deviation for unit noise of every pixel
    Numbers unit_shift;    // (N,) the same of the shift
    Numbers stepped;       // (N,) further shift if the background had a step behind the line: an object's edge along it
    Numbers stepped_unit;  // (N,) its standard deviation for unit noise of every pixel
    Table residuals;       // (N, T) grey levels
    Numbers rms;           // (N,) root mean square residual, corrected for the four unknowns
};

// One Gauss–Newton step from the centres (N,), along the profiles from the path.
Fits fit(const CrossSection& section, const Crossings& found, ConstVector centre);

// The line as the profiles show it, independent of the cross-section it was fitted with.
struct Observed {
    Table heights;  // (N, T) grey levels less the background, over the line's height; zeros where not chosen
    Taper taper;    // to first order
};

Observed observed(const CrossSection& section, const Crossings& found, ConstVector centre, const Fits& fits,
                  const Flags& chosen);

}  // namespace vbaa::detect
