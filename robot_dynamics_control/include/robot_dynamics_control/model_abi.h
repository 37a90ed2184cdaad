/*
 * The model of a robot for control laws, as `robot-dynamics generate ROBOT --control` writes it: names and limits of
 * the joints, and functions that compute efforts. It is plain C, so that a program can load the model of any robot
 * from a shared object.
 *
 * All numbers are SI. Efforts are those of the actuators at the joints. Functions allocate nothing, keep no state, and
 * read all inputs before they write outputs. NULL stands where a model does not need an argument.
 */

#ifndef ROBOT_DYNAMICS_CONTROL_MODEL_ABI_H
#define ROBOT_DYNAMICS_CONTROL_MODEL_ABI_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Version of the structs below. It changes where a program that was compiled with others must not use them. */
#define ROBOT_DYNAMICS_MODEL_ABI 2u

/* Name of the function that a shared object exports; its type is robot_dynamics_model_function. */
#define ROBOT_DYNAMICS_MODEL_SYMBOL "robot_dynamics_control_model"

/* Entries of the inertia of a payload: mass, first moments x y z, second moments xx xy xz yy yz zz. */
#define ROBOT_DYNAMICS_INERTIA_SIZE 10u

/* How positions of an independent joint lead from the reference positions of the loops to others. */
enum {
    ROBOT_DYNAMICS_MOVES_NO_LOOP = 0,
    ROBOT_DYNAMICS_MOVES_LOOPS = 1,
    ROBOT_DYNAMICS_MOVES_LOOPS_PERIODICALLY = 2 /* a whole turn brings the loops back to the same positions */
};

/* A joint of the state. Limits are infinite where the description has none. */
typedef struct robot_dynamics_joint {
    const char *name;
    double lower;         /* limits of the position [rad or m] */
    double upper;
    double velocity;      /* maximum speed [rad/s or m/s] */
    double effort;        /* maximum effort [N m or N] */
    double load_friction; /* effort of friction relative to that of the joint */
    uint32_t actuated;    /* 0: the joint has no motor */
    uint32_t prismatic;   /* 0: positions are angles [rad] */
} robot_dynamics_joint;

/* A position of the models: multiplier times a variable of the loops, plus an offset. */
typedef struct robot_dynamics_position {
    const char *name;
    uint32_t variable; /* index of the variable */
    double multiplier;
    double offset;
} robot_dynamics_position;

/*
 * Closed loops. Variables are the positions of the joints that mimic no other joint. Some are those of the joints of
 * the state, the others depend on them, and are found by Newton's method.
 */
typedef struct robot_dynamics_loops {
    uint32_t variable_count;
    uint32_t dependent_count;
    uint32_t row_count;               /* entries of the residual */
    uint32_t attitude_count;          /* of platforms */
    const uint32_t *independent;      /* [joint_count] variables of the joints of the state */
    const uint32_t *dependent;        /* [dependent_count] variables that the loops determine */
    const double *units;              /* [variable_count] change that counts as one radian [rad or m] */
    const double *reference;          /* [variable_count] closed positions, far from singular ones */
    const uint32_t *motion;           /* [joint_count] ROBOT_DYNAMICS_MOVES_... */
    const uint32_t (*attitudes)[3];   /* variables yaw, pitch, roll; steps of these are rotations about fixed axes */
    const robot_dynamics_position *positions; /* [position_count] of robot_dynamics_model */
    /* residual[row_count]; step, pivots, squared_norms [dependent_count]; matrix[dependent_count * dependent_count]:
     * its determinant is positive in the assembly mode of the reference positions */
    void (*step)(const double *variables, double *residual, double *step, double *pivots, double *squared_norms,
                 double *matrix);
} robot_dynamics_loops;

/* A spring with a damper between a motor and its link, on one axis. For `inverse` the spring is a motor too. */
typedef struct robot_dynamics_spring {
    uint32_t motor;   /* index of the joint of the motor */
    uint32_t joint;   /* index of the joint of the spring: its position is that of the link relative to the motor */
    double stiffness; /* [N m/rad or N/m] */
    double rest;      /* position without load [rad or m] */
    double damping;   /* [N m s/rad or N s/m] */
} robot_dynamics_spring;

typedef struct robot_dynamics_springs {
    uint32_t count;
    uint32_t decoupled; /* 1: the torques that the springs transmit do not depend on their deflections */
    const robot_dynamics_spring *springs;
} robot_dynamics_springs;

/* The model of a robot. joint_count numbers each: qd, qdd, efforts. position_count numbers: q. */
typedef struct robot_dynamics_model {
    uint32_t abi;            /* ROBOT_DYNAMICS_MODEL_ABI */
    uint32_t size;           /* sizeof(robot_dynamics_model) */
    const char *robot;       /* name of the robot */
    const char *generator;   /* program and version that wrote the model */
    uint32_t joint_count;    /* joints of the state */
    uint32_t position_count; /* positions that the models take: more than joint_count with loops */
    uint32_t moving_base;    /* 1: twist[6] and gravity[3], both in the base frame, are arguments */
    uint32_t payload_size;   /* ROBOT_DYNAMICS_INERTIA_SIZE, or 0: there is no such argument */
    const char *payload_frame; /* frame in which the inertia of the payload is expressed, at its origin */
    double gravity[3];       /* of the description, in the base frame [m/s^2] */
    const robot_dynamics_joint *joints;
    const robot_dynamics_loops *loops; /* NULL: none */
    const robot_dynamics_springs *springs; /* NULL: none */
    /* efforts of a motion, without the friction of joints with motors and of joints of loops */
    void (*inverse)(const double *q, const double *qd, const double *qdd, const double *twist, const double *gravity,
                    const double *payload, double *efforts);
    /* that friction, but for load_friction. NULL: none */
    void (*friction)(const double *q, const double *qd, double *efforts);
} robot_dynamics_model;

typedef const robot_dynamics_model *(*robot_dynamics_model_function)(void);

#ifdef __cplusplus
}
#endif

#endif
