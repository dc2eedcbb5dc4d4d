// Written by `cargo xtask web`; changes are lost.

export const text = "fn T9y(Tc:u32,T3:vec2<f32>,T0:u32)->vec4<f32>{let T4v=(Tc==1u)&(T2.Tdg==1u);let T4=Tb(select(T2.Tja,T2.Tjb,T4v),T0);let at=T3*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Tu=floor(at);let Ts=T22(vec2<i32>(Tu),T4);let T1m=T4q(Ts,T22(vec2<i32>(Tu)+vec2<i32>(1),T4),at-Tu);var a=vec4<f32>(0.0);if!T4v{a=T3t(T87,T1m,T0);}var b=a;if T4v|(T2.T4b==T4d){b=T3t(Td3,T1m,T0);}return T2b(select(a,b,T4v),b,T2.T4b);}\n";
