#include "carmap/slam/map_drive.h"

#include <string>

#include "carmap/base/exceptions.h"
#include "carmap/base/status_macros.h"
#include "carmap/slam/fix_judgement.h"
#include "carmap/slam/frame_extraction.h"

namespace carmap {

absl::StatusOr<MappedDrive> MapDrive(FrameSource& source, DriveId drive_id,
                                     const MapDriveOptions& options, const MapProgress& progress) {
  FrameExtraction frames(source, options.front_end, options.sequential);
  DriveMapper mapper(source.rig(), frames.front_end().rig(), drive_id, options);
  const absl::Status driven = CatchExceptions([&] {
    for (size_t taken = 1; const auto frame = frames.Next(); ++taken) {
      mapper.Take(*frame);
      if (progress) progress(taken, mapper.keyframe_count());
    }
  });
  if (!driven.ok() && mapper.keyframe_count() == 0) return driven;
  CARMAP_ASSIGN_OR_RETURN(MappedDrive mapped, mapper.Finish());
  mapped.stage_ms["read"] = frames.read_ms();
  if (source.gps() != nullptr) {
    mapped.gps =
        JudgeFixes(*source.gps(), mapped.trajectory, mapped.georeference, options.loops.gps);
  }
  if (!driven.ok()) mapped.failure = std::string(driven.message());
  return mapped;
}

}  // namespace carmap
