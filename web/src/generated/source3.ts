// Written by `cargo xtask web`; changes are lost.

export const text = "fn Tav(Te:u32,T2:vec2<f32>,T0:u32)->vec4<f32>{let T5n=(Te==1u)&(T3.Tem==1u);let T6=Td(select(T3.Tkm,T3.Tkn,T5n),T0);let at=T2*(1.0/f32(i32(1u<<T0)))-vec2<f32>(0.5);let Tv=floor(at);let Ty=T2c(vec2<i32>(Tv),T6);let T1q=T5f(Ty,T2c(vec2<i32>(Tv)+vec2<i32>(1),T6),at-Tv);var a=vec4<f32>(0.0);if!T5n{a=T42(T98,T1q,T0);}var b=a;if T5n|(T3.T4u==T4w){b=T42(Te7,T1q,T0);}return T2o(select(a,b,T5n),b,T3.T4u);}\n";
