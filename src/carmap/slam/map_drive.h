// From a recorded or live drive to its map: reader, front end and DriveMapper wired together (paper
// §2).
//
// By default each stage has a thread of its own: reading and feature extraction work ahead while
// the mapper takes a keyframe in.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <functional>

#include "carmap/base/ids.h"
#include "carmap/dataset/frame_source.h"
#include "carmap/slam/drive_mapper.h"

namespace carmap {

/// Called after each frame with the number of frames and keyframes so far.
using MapProgress = std::function<void(size_t frames, size_t keyframes)>;

/// Maps what can be tracked; frames that cannot are listed with the reason. A drive that cannot go
/// on in its map begins a new part, which lies where the vehicle must have come to, and is joined
/// to the rest when it is found there.
/// What a stage throws ends the drive there, and is the map's `failure`.
/// Errors: as DriveMapper::Finish.
absl::StatusOr<MappedDrive> MapDrive(FrameSource& source, DriveId drive_id,
                                     const MapDriveOptions& options,
                                     const MapProgress& progress = {});

}  // namespace carmap
