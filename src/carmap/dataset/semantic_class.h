// What a pixel shows: the classes of the Cityscapes benchmark, by their train ids.
#pragma once

#include <cstdint>

namespace carmap {

enum class SemanticClass : uint8_t {
  kRoad = 0,
  kSidewalk = 1,
  kBuilding = 2,
  kWall = 3,
  kFence = 4,
  kPole = 5,
  kTrafficLight = 6,
  kTrafficSign = 7,
  kVegetation = 8,
  kTerrain = 9,
  kSky = 10,
  kPerson = 11,
  kRider = 12,
  kCar = 13,
  kTruck = 14,
  kBus = 15,
  kTrain = 16,
  kMotorcycle = 17,
  kBicycle = 18,
  kUnlabelled = 255,  ///< none of them; Cityscapes' "ignore"
};

}  // namespace carmap
