#include "carmap/semantics/mobility.h"

#include <gtest/gtest.h>

namespace carmap {
namespace {

TEST(MobilityTest, WhatCanMoveIsNonStatic) {
  for (const SemanticClass moves :
       {SemanticClass::kPerson, SemanticClass::kRider, SemanticClass::kCar, SemanticClass::kTruck,
        SemanticClass::kBus, SemanticClass::kTrain, SemanticClass::kMotorcycle,
        SemanticClass::kBicycle}) {
    EXPECT_EQ(MobilityOf(moves), Mobility::kNonStatic) << static_cast<int>(moves);
  }
  for (const SemanticClass stays :
       {SemanticClass::kRoad, SemanticClass::kSidewalk, SemanticClass::kBuilding,
        SemanticClass::kWall, SemanticClass::kFence, SemanticClass::kPole,
        SemanticClass::kTrafficLight, SemanticClass::kTrafficSign, SemanticClass::kVegetation,
        SemanticClass::kTerrain, SemanticClass::kSky}) {
    EXPECT_EQ(MobilityOf(stays), Mobility::kStatic) << static_cast<int>(stays);
  }
  EXPECT_EQ(MobilityOf(SemanticClass::kUnlabelled), Mobility::kUnknown);
  EXPECT_EQ(MobilityOf(static_cast<SemanticClass>(19)), Mobility::kUnknown);
}

TEST(MobilityTest, KnowsTheNamesOfCityscapes) {
  EXPECT_EQ(SemanticClassOf("road"), SemanticClass::kRoad);
  EXPECT_EQ(SemanticClassOf("traffic light"), SemanticClass::kTrafficLight);
  EXPECT_EQ(SemanticClassOf("sky"), SemanticClass::kSky);
  EXPECT_EQ(SemanticClassOf("person"), SemanticClass::kPerson);
  EXPECT_EQ(SemanticClassOf("bicycle"), SemanticClass::kBicycle);
  EXPECT_EQ(SemanticClassOf("Road"), std::nullopt);
  EXPECT_EQ(SemanticClassOf(""), std::nullopt);
  EXPECT_EQ(SemanticClassOf("static"), std::nullopt);
}

TEST(MobilityTest, KnowsItsOwnNames) {
  EXPECT_EQ(MobilityOfName("static"), Mobility::kStatic);
  EXPECT_EQ(MobilityOfName("non-static"), Mobility::kNonStatic);
  EXPECT_EQ(MobilityOfName("unlabelled"), Mobility::kUnknown);
  EXPECT_EQ(MobilityOfName("truck"), Mobility::kNonStatic);
  EXPECT_EQ(MobilityOfName("pole"), Mobility::kStatic);
  EXPECT_EQ(MobilityOfName("lorry"), std::nullopt);
}

TEST(MobilityVotesTest, NonStaticTakesTwoInThree) {
  MobilityVotes votes;
  EXPECT_EQ(votes.Elected(), Mobility::kUnknown);
  votes.Add(Mobility::kUnknown);
  EXPECT_EQ(votes, MobilityVotes());
  votes.Add(Mobility::kNonStatic);
  EXPECT_EQ(votes.Elected(), Mobility::kNonStatic);
  votes.Add(Mobility::kStatic);
  votes.Add(Mobility::kNonStatic);
  EXPECT_EQ(votes.Elected(), Mobility::kStatic);
  votes.Add(Mobility::kNonStatic);
  EXPECT_EQ(votes.Elected(), Mobility::kNonStatic);
  votes.Add(Mobility::kNonStatic, -1);
  EXPECT_EQ(votes, (MobilityVotes{.is_static = 1, .non_static = 2}));
}

}  // namespace
}  // namespace carmap
