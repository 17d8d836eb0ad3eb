#include "plant/arm_plant.h"

#include <ode/ode.h>

#include <array>
#include <cmath>
#include <stdexcept>

namespace hpmc {

namespace {

constexpr std::size_t links = 3;

/// ODE is started with the first plant of the process and closed at its end.
void init_ode_once() {
    struct Library {
        Library() { dInitODE2(0); }
        ~Library() { dCloseODE(); }
    };
    static const Library library;
}

struct WorldDelete {
    void operator()(dWorldID world) const { dWorldDestroy(world); }
};

struct JointGroupDelete {
    void operator()(dJointGroupID group) const { dJointGroupDestroy(group); }
};

void check(const ArmPlantConfig &config) {
    if (!config.length_m.allFinite() || !(config.length_m.minCoeff() > 0.0)) {
        throw std::invalid_argument("plant.length_m: every link must be longer than 0");
    }
    if (!config.mass_kg.allFinite() || !(config.mass_kg.minCoeff() > 0.0)) {
        throw std::invalid_argument("plant.mass_kg: every link must be heavier than 0");
    }
    if (!(config.joint_friction_Nm_s_rad >= 0.0 && config.joint_friction_Nm_s_rad <= 1.0)) {
        throw std::invalid_argument("plant.joint_friction_Nm_s_rad: must be in 0..1");
    }
    if (!(config.step_s >= 0.00005 && config.step_s <= 0.001)) {
        throw std::invalid_argument("plant.step_s: must be in 0.00005..0.001");
    }
    const WallConfig &wall = config.wall;
    if (!wall.point_m.allFinite() || !std::isfinite(wall.normal_rad)) {
        throw std::invalid_argument("wall.point_m, wall.normal_rad: must be finite");
    }
    if (!(wall.stiffness_N_m >= 1e3 && wall.stiffness_N_m <= 1e5)) {
        throw std::invalid_argument("wall.stiffness_N_m: must be in 1e3..1e5");
    }
    if (!(wall.damping_N_s_m >= 0.0 && wall.damping_N_s_m <= 1000.0)) {
        throw std::invalid_argument("wall.damping_N_s_m: must be in 0..1000");
    }
}

} // namespace

struct ArmPlant::World {
    explicit World(const ArmPlantConfig &plant_config);

    void reset(const Eigen::Vector3d &q_rad);
    void step();
    bool touch_wall();
    Eigen::Vector3d link_rates_rad_s() const;
    void track_angles();

    ArmPlantConfig config;
    std::unique_ptr<dxWorld, WorldDelete> world; // owns bodies and joints
    std::unique_ptr<dxJointGroup, JointGroupDelete> contacts;
    std::array<dBodyID, links> body{};
    dContact contact{}; ///< of the hand's end with the wall: all but place and depth
    dJointFeedback contact_force{};

    Eigen::Vector3d link_angle_rad = Eigen::Vector3d::Zero(); ///< from +x, never wrapped
    Eigen::Vector3d link_rate_rad_s = Eigen::Vector3d::Zero();
    /// ODE's velocities lag its positions by half a step; this is the one before, to extrapolate.
    Eigen::Vector3d link_rate_before_rad_s = Eigen::Vector3d::Zero();

    Eigen::Vector3d tau_Nm = Eigen::Vector3d::Zero();
    Eigen::Vector2d external_force_N = Eigen::Vector2d::Zero();
    Eigen::Vector3d tau_before_Nm = Eigen::Vector3d::Zero();
    Eigen::Vector2d external_force_before_N = Eigen::Vector2d::Zero();
    Eigen::Vector2d wall_force_N = Eigen::Vector2d::Zero(); ///< of the wall on the hand
};

ArmPlant::World::World(const ArmPlantConfig &plant_config)
    : config(plant_config), world(dWorldCreate()) {
    dWorldSetERP(world.get(), 1.0);
    dWorldSetCFM(world.get(), 0.0);
    dWorldSetAutoDisableFlag(world.get(), 0);
    dWorldSetDamping(world.get(), 0.0, 0.0);

    double shoulder_m = 0.0;
    for (std::size_t i = 0; i < links; ++i) {
        const auto row = static_cast<Eigen::Index>(i);
        const double length_m = config.length_m[row];
        const double mass_kg = config.mass_kg[row];
        // A slender rod along x. ODE wants a positive moment about x, which a planar motion never
        // feels.
        const double inertia_kg_m2 = mass_kg * length_m * length_m / 12.0;
        dMass mass;
        dMassSetZero(&mass);
        dMassSetParameters(&mass, mass_kg, 0.0, 0.0, 0.0, inertia_kg_m2, inertia_kg_m2,
                           inertia_kg_m2, 0.0, 0.0, 0.0);
        body[i] = dBodyCreate(world.get());
        dBodySetMass(body[i], &mass);
        dBodySetPosition(body[i], shoulder_m + length_m / 2.0, 0.0, 0.0);
        dBodySetFiniteRotationMode(body[i], 1);

        const dJointID hinge = dJointCreateHinge(world.get(), nullptr);
        dJointAttach(hinge, body[i], i == 0 ? nullptr : body[i - 1]);
        dJointSetHingeAnchor(hinge, shoulder_m, 0.0, 0.0);
        dJointSetHingeAxis(hinge, 0.0, 0.0, 1.0);
        shoulder_m += length_m;
    }

    const WallConfig &wall = config.wall;
    if (wall.present()) {
        contacts.reset(dJointGroupCreate(0));
        const double implicit_damping = config.step_s * wall.stiffness_N_m + wall.damping_N_s_m;
        contact.surface.mode = dContactSoftERP | dContactSoftCFM;
        contact.surface.soft_erp = config.step_s * wall.stiffness_N_m / implicit_damping;
        contact.surface.soft_cfm = 1.0 / implicit_damping;
        contact.geom.normal[0] = std::cos(wall.normal_rad);
        contact.geom.normal[1] = std::sin(wall.normal_rad);
    }
}

/// Puts a contact joint where the hand's end is behind the wall's surface.
bool ArmPlant::World::touch_wall() {
    dVector3 end_m;
    dBodyGetRelPointPos(body[2], config.length_m[2] / 2.0, 0.0, 0.0, end_m);
    const WallConfig &wall = config.wall;
    const dReal *normal = contact.geom.normal;
    contact.geom.depth =
        (wall.point_m.x() - end_m[0]) * normal[0] + (wall.point_m.y() - end_m[1]) * normal[1];
    if (!(contact.geom.depth > 0.0)) {
        return false;
    }
    contact.geom.pos[0] = end_m[0];
    contact.geom.pos[1] = end_m[1];
    const dJointID joint = dJointCreateContact(world.get(), contacts.get(), &contact);
    dJointAttach(joint, body[2], nullptr);
    dJointSetFeedback(joint, &contact_force);
    return true;
}

void ArmPlant::World::reset(const Eigen::Vector3d &q_rad) {
    Eigen::Vector2d joint_m = Eigen::Vector2d::Zero();
    double angle_rad = 0.0;
    for (std::size_t i = 0; i < links; ++i) {
        const auto row = static_cast<Eigen::Index>(i);
        angle_rad += q_rad[row];
        const Eigen::Vector2d along(std::cos(angle_rad), std::sin(angle_rad));
        const Eigen::Vector2d centre_m = joint_m + config.length_m[row] / 2.0 * along;
        const dQuaternion rotation = {std::cos(angle_rad / 2.0), 0.0, 0.0,
                                      std::sin(angle_rad / 2.0)};
        dBodySetPosition(body[i], centre_m.x(), centre_m.y(), 0.0);
        dBodySetQuaternion(body[i], rotation);
        dBodySetLinearVel(body[i], 0.0, 0.0, 0.0);
        dBodySetAngularVel(body[i], 0.0, 0.0, 0.0);
        dBodySetForce(body[i], 0.0, 0.0, 0.0);
        dBodySetTorque(body[i], 0.0, 0.0, 0.0);
        link_angle_rad[row] = angle_rad;
        joint_m += config.length_m[row] * along;
    }
    track_angles();
    link_rate_rad_s.setZero();
    link_rate_before_rad_s.setZero();
    tau_Nm.setZero();
    external_force_N.setZero();
    tau_before_Nm.setZero();
    external_force_before_N.setZero();
    wall_force_N.setZero();
}

/// Reads the links' angles off their rotation and continues them across a full turn.
void ArmPlant::World::track_angles() {
    for (std::size_t i = 0; i < links; ++i) {
        const dReal *rotation = dBodyGetRotation(body[i]);
        double &angle_rad = link_angle_rad[static_cast<Eigen::Index>(i)];
        const double wrapped_rad = std::atan2(rotation[4], rotation[0]);
        angle_rad += std::remainder(wrapped_rad - angle_rad, 2.0 * M_PI);
    }
}

/// Angular velocities at the present positions, to second order.
Eigen::Vector3d ArmPlant::World::link_rates_rad_s() const {
    return 1.5 * link_rate_rad_s - 0.5 * link_rate_before_rad_s;
}

void ArmPlant::World::step() {
    // Half kick: ODE's velocities belong to half a step ago, so the step that spans a change of
    // torque feels the old one for its first half.
    const Eigen::Vector3d applied_Nm = 0.5 * (tau_before_Nm + tau_Nm);
    const Eigen::Vector2d force_N = 0.5 * (external_force_before_N + external_force_N);
    tau_before_Nm = tau_Nm;
    external_force_before_N = external_force_N;

    const Eigen::Vector3d rate = link_rates_rad_s();
    const double b = config.joint_friction_Nm_s_rad;
    const double tau_1 = applied_Nm[0] - b * rate[0];
    const double tau_2 = applied_Nm[1] - b * (rate[1] - rate[0]);
    const double tau_3 = applied_Nm[2] - b * (rate[2] - rate[1]);
    dBodyAddTorque(body[0], 0.0, 0.0, tau_1 - tau_2);
    dBodyAddTorque(body[1], 0.0, 0.0, tau_2 - tau_3);
    dBodyAddTorque(body[2], 0.0, 0.0, tau_3);
    if (force_N.x() != 0.0 || force_N.y() != 0.0) {
        dBodyAddForceAtRelPos(body[2], force_N.x(), force_N.y(), 0.0, config.length_m[2] / 2.0, 0.0,
                              0.0);
    }
    const bool touching = config.wall.present() && touch_wall();
    dWorldStep(world.get(), config.step_s);
    if (config.wall.present()) {
        wall_force_N.setZero();
        if (touching) {
            wall_force_N << contact_force.f1[0], contact_force.f1[1];
            dJointGroupEmpty(contacts.get());
        }
    }

    link_rate_before_rad_s = link_rate_rad_s;
    for (std::size_t i = 0; i < links; ++i) {
        link_rate_rad_s[static_cast<Eigen::Index>(i)] = dBodyGetAngularVel(body[i])[2];
    }
}

ArmPlant::ArmPlant(const ArmPlantConfig &config) {
    check(config);
    init_ode_once();
    world_ = std::make_unique<World>(config);
    world_->reset(Eigen::Vector3d::Zero());
}

ArmPlant::~ArmPlant() = default;

void ArmPlant::reset(const Eigen::Vector3d &q_rad) {
    world_->reset(q_rad);
}

void ArmPlant::set_external_force(const Eigen::Vector2d &force_N) {
    world_->external_force_N = force_N;
}

void ArmPlant::advance(const Eigen::Vector3d &tau_Nm, double duration_s) {
    world_->tau_Nm = tau_Nm;
    const long steps = std::lround(duration_s / world_->config.step_s);
    for (long i = 0; i < steps; ++i) {
        world_->step();
    }
    world_->track_angles();
}

void ArmPlant::advance_ode_alone(long steps) {
    for (long i = 0; i < steps; ++i) {
        dWorldStep(world_->world.get(), world_->config.step_s);
    }
}

ArmPlantState ArmPlant::state() const {
    const World &world = *world_;
    const Eigen::Vector3d &angle = world.link_angle_rad;
    const Eigen::Vector3d rate = world.link_rates_rad_s();
    ArmPlantState state;
    state.q_rad = {angle[0], angle[1] - angle[0], angle[2] - angle[1]};
    state.qd_rad_s = {rate[0], rate[1] - rate[0], rate[2] - rate[1]};
    state.hand_m.setZero();
    state.hand_m_s.setZero();
    for (Eigen::Index i = 0; i < 3; ++i) {
        const double length_m = world.config.length_m[i];
        const Eigen::Vector2d along(std::cos(angle[i]), std::sin(angle[i]));
        state.hand_m += length_m * along;
        state.hand_m_s += length_m * rate[i] * Eigen::Vector2d(-along.y(), along.x());
    }
    state.wrench_N = -world.external_force_N;
    if (world.config.wall.present()) {
        state.wrench_N -= world.wall_force_N;
    }
    return state;
}

} // namespace hpmc
