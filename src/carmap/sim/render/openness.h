// How open the sky is to each pixel, from one look in one direction at every other.
//
// Neighbours on the same surface look in other directions: together they know enough (interleaved
// sampling, Keller and Heidrich 2001). Pure functions.
#pragma once

#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "carmap/sim/render/shader.h"

namespace carmap {

inline constexpr int kTileWidth = 32, kTileHeight = 16;  ///< most of a tile

/// The direction, of Shader::kSkyDirections, in which a pixel looks, if it does.
std::optional<int> SkyDirectionAt(int x, int y);

/// Whether about the same share of the sky is open to both.
bool Neighbourly(const Sample& a, const Sample& b);

/// Writes `openness` of the samples in `tile`. `samples` are all of an image of that size, row by
/// row; others than in `tile` are only read, and not their openness.
void SpreadOpenness(const cv::Rect& tile, const cv::Size& size, std::vector<Sample>& samples);

}  // namespace carmap
