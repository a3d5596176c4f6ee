#version 330
uniform mat4 clip_from_world;
in vec3 in_position;
in vec3 in_normal;
in mat4 in_world_from_prop;
in vec4 in_colour;  // linear RGB, strength of its texture
in float in_leaves;
out vec3 position;
out vec3 place;  // texture coordinates
out vec3 normal;
out vec4 base;
out float leaves;

void main() {
    vec4 p = in_world_from_prop * vec4(in_position, 1.0);
    position = p.xyz;
    place = p.xyz;
    mat3 m = mat3(in_world_from_prop);
    normal = transpose(inverse(m)) * in_normal;
    base = in_colour;
    leaves = in_leaves;
    gl_Position = clip_from_world * p;
}
