// From labels of pixels to labels of features (§3.3). Pure.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/semantics/mobility.h"

namespace carmap {

/// Mobility of the pixel that each feature lies in, by feature. `feature_image` is the size in
/// whose pixels features are (StereoFrontEnd::rig's: small images are enlarged); `mobility`, of
/// Segmenter::Segment, shows the same view at any other size.
std::vector<Mobility> MobilityOfFeatures(const std::vector<Feature>& features,
                                         cv::Size feature_image, const cv::Mat& mobility);

}  // namespace carmap
