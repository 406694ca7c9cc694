#include "carmap/slam/map_drive.h"

#include "carmap/slam/frame_extraction.h"

namespace carmap {

absl::StatusOr<MappedDrive> MapDrive(FrameSource& source, DriveId drive_id,
                                     const MapDriveOptions& options, const MapProgress& progress) {
  FrameExtraction frames(source, options.front_end, options.sequential);
  DriveMapper mapper(frames.front_end().rig(), drive_id, options);
  for (size_t taken = 1; const auto frame = frames.Next(); ++taken) {
    mapper.Take(*frame);
    if (progress) progress(taken, mapper.keyframe_count());
  }
  auto mapped = mapper.Finish();
  if (mapped.ok()) mapped->stage_ms["read"] = frames.read_ms();
  return mapped;
}

}  // namespace carmap
