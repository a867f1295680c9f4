// An antenna in its strip of the picture: an opaque ribbon of known width between two backgrounds that are free in
// every profile. Its brightness across it, the series of shades.hpp in each of the picture's channels, changes smoothly
// along it. Its course across the strip is a smooth curve. All of it is solved for together, by Gauss–Newton, with
// Gaussian priors of standard deviations from the picture itself (empirical Bayes); a chain decides in which profiles
// it is hidden.
#pragma once

#include <vector>

#include "detect/crossings.hpp"
#include "detect/shades.hpp"

namespace vbaa::detect {

// Priors of a ribbon.
struct RibbonPriors {
    double width_std, blur_std, taper_std;  // prior deviations, of logarithms; of the part by which it tapers
    double shades;                          // over the antenna's contrast
    double bend_px;                         // σ of the course's second difference over 20 px
    double knot_px;                         // between which its shades change linearly
    double alike;                           // share of a profile's log odds that its neighbours do not have, too
    double change_px;                       // length after which it is hidden, or seen again
    double cut;                             // deviations at which a pixel counts half
    int passes;                             // rounds
};

// The fitted ribbon in N profiles.
struct Ribbon {
    Numbers centre;     // (N,) along the profiles from the path, px
    Numbers sigma_px;   // (N,) deviation across the antenna, by the pixels of the profile alone
    Numbers shared_px;  // (N,) part of the place's error that neighbours share: by unknown light, width and blur
    Numbers seen;       // (N,) probability that it is seen there
    Numbers height;     // (N,) brightness above the mean of its two sides, grey levels: rms over its width and all
                        // channels
    int strongest;      // channel in which it stands out the most
    Table shades;       // (N, SHADES) above the mean of both sides, grey levels of that channel
    double noise;       // of a pixel, grey levels
    double pattern;     // variance of the residual pattern common to its whole length, over the noise's
    double width_px, blur_px;
};

// Profiles (one entry a channel, of the same path) of an antenna of this width, seen through this blur.
Ribbon fitted_ribbon(const std::vector<Crossings>& channels, double width_px, double blur_px,
                     const RibbonPriors& model);

}  // namespace vbaa::detect
