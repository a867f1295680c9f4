#include "bindings/numpy.hpp"
#include "detect/corner_covariance.hpp"

namespace vbaa {
namespace {

auto corner_covariances(const Numpy<const std::uint8_t, 2>& image, const Numpy<const float, 2>& smooth,
                        const InMatrix& corners_px, const Numpy<const std::int64_t, 1>& windows, double trimming,
                        nb::handle settings) {
    require(image.size() > 0 && smooth.shape(0) == image.shape(0) && smooth.shape(1) == image.shape(1),
            "a picture and the smoothed one are (H, W), not empty");
    require(corners_px.shape(1) == 2 && corners_px.shape(0) == windows.size(), "each corner (N, 2) has a window");
    for (const std::int64_t each : view(windows)) require(each > 0 && each < 1000, "half windows are 1 to 999 px");
    detect::CornerNoise model = {};
    model.trimming = trimming;
    for (auto [name, to] : {std::pair{"smoothing_px", &model.smoothing_px},
                            {"least_variance", &model.least},
                            {"flat", &model.flat},
                            {"flat_kept", &model.flat_kept},
                            {"least_fixed", &model.least_fixed},
                            {"least_kept", &model.least_kept}})
        *to = number<double>(settings, name);
    model.flat_pixels = number<int>(settings, "flat_pixels");
    model.largest_sample = number<int>(settings, "largest_sample");
    require(model.smoothing_px > 0.0 && model.smoothing_px < 100.0, "pictures are smoothed by 0 to 100 px");
    require(model.largest_sample > 0 && model.flat_kept > 0.0 && model.flat_kept <= 1.0, "noise is measured somewhere");
    return to_numpy(unlocked(
        [&] { return detect::corner_covariances(view(image), view(smooth), view(corners_px), view(windows), model); }));
}

}  // namespace

void bind_board(nb::module_& module) {
    nb::module_ room = module.def_submodule("board", "A board's corners in a picture.");
    room.def("corner_covariances", corner_covariances, "(N, 2, 2) px^2 of refined corners by the picture's noise.");
}

}  // namespace vbaa
